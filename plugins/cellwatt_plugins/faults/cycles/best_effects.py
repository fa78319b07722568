"""Finds the few effects that best explain a residual: at most one harmless effect and two faults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.effects import Effect, joint_effects, part_effects, supply_effects, warm_up
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.off_path import Interpretation
from cellwatt_plugins.faults.cycles.samples import Samples
from cellwatt_plugins.faults.cycles.weigh import Weighed, bend, fit, weigh
from cellwatt_plugins.robot.regression import Products, Whitener

WARM = 0.15
"""Harmless change of the friction of all joints, as a share (one sigma)."""
HARMLESS_ODDS = 6.0
"""Log odds against a part of another weight that is held in certain moves, or a load of the supply that switches …"""
FAULT_ODDS, USUAL_RATE = 7.0, 1e-4
"""… and against a given fault in a cycle, for this accepted share of healthy intervals with a false alarm."""
MOST_FAULTS = 2
SHORTLIST = 4
"""Number of sets with the best linear evidence that are evaluated in full, and of part effects tried with faults."""
POOL = 10
"""Number of faults with the best linear evidence that are tried in pairs."""
UNEXPLAINED = 3.0
"""Residual variance relative to the noise from which faults are evaluated in full even if no linear one explains it:
while the supply burns the power that drives return, power has no slope. A smaller residual may come from harmless
changes, which are modelled only linearly."""
ALIKE = 5.0
"""Samples over which an unexplained residual is correlated: its variance is multiplied by this."""


@dataclass(frozen=True)
class BestExplanation:
    """The best explanation under one interpretation.

    ``effects`` with their ``sizes`` and ``watts`` (N,); ``likelihood``: log likelihood up to a constant of the cycle;
    ``odds``: prior log odds against it; ``rivals``: for each fault among the effects, (likelihood, odds) with the fault
    moved to each joint (0-based), and without it (-1); ``misfit``: residual variance relative to the noise.
    """

    interpretation: Interpretation
    effects: tuple[Effect, ...]
    sizes: tuple[Float, ...]
    watts: tuple[Float, ...]
    likelihood: float
    odds: float
    rivals: tuple[dict[int, tuple[float, float]], ...]
    misfit: float


def temper_of(misfit: float) -> float:
    """Factor by which a residual variance ``misfit`` weakens the evidence, as model errors are not white noise."""
    return 1.0 + ALIKE * max(0.0, misfit - 1.0)


def odds_of(rate: float) -> float:
    """Log odds against a fault for an accepted share ``rate`` of healthy intervals with a false alarm.

    Without a fault the mean of a likelihood ratio is 1, so a ratio above e^x occurs by chance in a share of at most
    e^-x of all cases: the log odds change with the logarithm of the share.
    """
    return FAULT_ODDS + math.log(USUAL_RATE / rate)


def explain(
    arm: FittedArm, samples: Samples, interpretation: Interpretation, inside: Float, fault_odds: float = FAULT_ODDS
) -> BestExplanation:
    """Explain the residual of one interpretation; ``inside`` (N, M + 1) is 1 for samples after each move's start."""
    load, shown = interpretation.load, [j for j in range(arm.body.joints) if j not in interpretation.silent]
    effects = [effect for joint in shown for effect in joint_effects(arm, load, joint)]
    effects += part_effects(arm, load, inside)
    shared = [samples.harmless, interpretation.doubt, WARM * warm_up(arm.parameters, load)[:, None]]
    white = Whitener.of(samples.sigma, np.column_stack(shared), samples.group)
    effects += supply_effects(white, white(interpretation.residual), len(samples.tau))
    search = _Search(arm.parameters, interpretation, white, effects, fault_odds)
    best: tuple[int, ...] = ()
    while (better := search.extended(best)) is not None:
        best = search.settled(better)
    found = search.weighed(best)
    chosen = tuple(effects[k] for k in best)
    return BestExplanation(
        interpretation=interpretation,
        effects=chosen,
        sizes=found.sizes,
        watts=tuple(bend(arm.parameters, load, (e,), (s,)).power for e, s in zip(chosen, found.sizes, strict=True)),
        likelihood=found.gain - 0.5 * float(search.residual @ search.residual) - 0.5 * white.log_det,
        odds=search.odds(best),
        rivals=tuple(search.rivals(best, k) for k in best if not effects[k].harmless),
        misfit=found.misfit / max(1, len(search.residual)),
    )


class _Search:
    """Compares sets of effects (as indices) by evidence and prior odds; a set has at most ``room`` faults."""

    def __init__(
        self, parameters: Parameters, given: Interpretation, white: Whitener, effects: Sequence[Effect], odds: float
    ) -> None:
        self.effects, self._white, self._fault_odds = effects, white, odds
        self._parameters, self._load = parameters, given.load
        self.room, self.residual = MOST_FAULTS - len(given.stopped), white(given.residual)
        ends = np.cumsum([e.columns.shape[1] for e in effects])
        self._columns = [np.arange(end - e.columns.shape[1], end) for e, end in zip(effects, ends, strict=True)]
        self._straight = Products.of(white(np.column_stack([e.columns for e in effects])), self.residual)
        self._known: dict[tuple[int, ...], Weighed] = {}
        self._lines: dict[tuple[int, ...], float] = {}

    def weighed(self, chosen: tuple[int, ...]) -> Weighed:
        """Evaluate a set with the full, nonlinear power of its torques."""
        if not chosen:
            return Weighed(0.0, (), self._straight.square)
        if chosen not in self._known:
            effects = [self.effects[k] for k in chosen]
            self._known[chosen] = weigh(self._parameters, self._load, self._white, self.residual, effects)
        return self._known[chosen]

    def odds(self, chosen: Iterable[int]) -> float:
        """Prior log odds against a set."""
        return sum(HARMLESS_ODDS if self.effects[k].harmless else self._fault_odds for k in chosen)

    def gain(self, chosen: tuple[int, ...]) -> float:
        """Log evidence relative to no effect; minus infinity if a size has the wrong sign."""
        found = self.weighed(chosen)
        return self._if_sensible(chosen, found.sizes, found.gain)

    def _if_sensible(self, chosen: tuple[int, ...], sizes: Sequence[Float], gain: float) -> float:
        right = all(self.effects[k].sensible(size) for k, size in zip(chosen, sizes, strict=True))
        return gain if right else -math.inf

    def extended(self, best: tuple[int, ...]) -> tuple[int, ...] | None:
        """The best set with one more effect, if better than ``best``; a pair may exclude the effect of ``best``."""
        shortlist = self._singles() if not best else self._longer(best)
        top = max(shortlist, key=lambda chosen: self.gain(chosen) - self.odds(chosen), default=None)
        if top is None:
            return None
        temper = temper_of(self.weighed(top).misfit / len(self.residual))
        gained = (self.gain(top) - self.gain(best)) / temper - self.odds(top) + self.odds(best)
        return top if gained > 0.0 else None

    def settled(self, best: tuple[int, ...]) -> tuple[int, ...]:
        """Replace faults of a set one at a time by better ones, until none improves it."""
        for _ in range(MOST_FAULTS):
            faults = [k for k in best if not self.effects[k].harmless]
            sets = {s for k in faults for s in self._in_place(best, k)} | {best}
            top = max(sorted(sets), key=lambda chosen: self.gain(chosen) - self.odds(chosen))
            if top == best:
                break
            best = top
        return best

    def rivals(self, best: tuple[int, ...], blamed: int) -> dict[int, tuple[float, float]]:
        """Gain and odds with one effect of ``best`` moved to each joint; key -1: without the effect."""
        others = tuple(k for k in best if k != blamed)
        out = {-1: (self.gain(others), self.odds(others))}
        for chosen, k in self._in_place(best, blamed).items():
            joint, gain = self.effects[k].joint, self.gain(chosen)
            if joint is not None and gain > out.get(joint, (-math.inf, 0.0))[0]:
                out[joint] = (gain, self.odds(chosen))
        return out

    def _in_place(self, best: tuple[int, ...], blamed: int) -> dict[tuple[int, ...], int]:
        """The sets in which a fault replaces ``blamed``, with the replacing fault."""
        others = tuple(k for k in best if k != blamed)
        faults = (k for k, effect in enumerate(self.effects) if not effect.harmless and k not in others)
        sets = {tuple(sorted((*others, k))): k for k in faults}
        return {chosen: k for chosen, k in sets.items() if self._allowed(chosen)}

    def _singles(self) -> list[tuple[int, ...]]:
        """Single effects to evaluate in full; none if the residual is small and no linear effect explains it."""
        gains = {k: self._line((k,)) - self.odds((k,)) for k in range(len(self.effects)) if self._allowed((k,))}
        ranked = sorted(gains, key=lambda k: gains[k], reverse=True)
        little = self._straight.square < UNEXPLAINED * len(self.residual)
        if not ranked or (little and gains[ranked[0]] < 0.0):
            return []
        parts = [k for k in ranked if self.effects[k].harmless][:SHORTLIST]
        return [(k,) for k in ranked if not self.effects[k].harmless or k in parts]

    def _longer(self, best: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Best candidates with one more effect: by the slope at ``best``, and pairs by the slope without a fault."""
        extended = {tuple(sorted((*best, k))): k for k in range(len(self.effects)) if k not in best}
        extended = {chosen: k for chosen, k in extended.items() if self._allowed(chosen)}
        gains = dict(zip(extended, self._beside(best, list(extended.values())), strict=True))
        out = sorted(gains, key=lambda chosen: gains[chosen] - self.odds(chosen), reverse=True)[:SHORTLIST]
        if len(best) == 1:
            pairs = [pair for pair in combinations(self._pool(best), 2) if self._allowed(pair) and pair not in out]
            out += sorted(pairs, key=lambda pair: self._line(pair) - self.odds(pair), reverse=True)[:SHORTLIST]
        return out

    def _beside(self, best: tuple[int, ...], more: Sequence[int]) -> list[float]:
        """Gain of each further effect in addition to ``best``, by the slope of power at the sizes of ``best``."""
        found = self.weighed(best)
        effects = [self.effects[k] for k in (*best, *more)]
        none = [np.zeros(effect.columns.shape[1]) for effect in effects[len(best) :]]
        bent = bend(self._parameters, self._load, effects, (*found.sizes, *none))
        widths = [effect.columns.shape[1] for effect in effects]
        cuts = np.cumsum(widths)
        own = np.concatenate([np.arange(cuts[len(best) - 1]), cuts[-1] + np.arange(bent.doubt.shape[1])])
        columns = self._white(np.column_stack([bent.slope, bent.doubt]))
        flat = self.residual - self._white(bent.power) + columns[:, : cuts[len(best) - 1]] @ np.concatenate(found.sizes)
        products = Products.of(columns, flat)
        alone = fit(products.part(own)).evidence
        ends = zip(cuts[len(best) - 1 : -1], cuts[len(best) :], strict=True)
        return [fit(products.part(np.concatenate([own, np.arange(a, b)]))).evidence - alone for a, b in ends]

    def _line(self, chosen: tuple[int, ...]) -> float:
        """Linear log evidence, by the slope of power without any fault."""
        if chosen not in self._lines:
            columns = [self._columns[k] for k in chosen]
            found = fit(self._straight.part(np.concatenate(columns)))
            sizes = np.split(found.coefficients, np.cumsum([len(each) for each in columns])[:-1])
            self._lines[chosen] = self._if_sensible(chosen, sizes, found.evidence)
        return self._lines[chosen]

    def _allowed(self, chosen: tuple[int, ...]) -> bool:
        joints = [j for k in chosen if (j := self.effects[k].joint) is not None]
        parts = len(chosen) - len(joints)
        return len(joints) <= self.room and len(set(joints)) == len(joints) and parts <= 1

    def _pool(self, best: Sequence[int]) -> list[int]:
        """The faults and the part effects with the best linear evidence alone, and those of ``best``."""
        ranked = sorted(range(len(self.effects)), key=lambda k: self._line((k,)), reverse=True)
        faults = [k for k in ranked if not self.effects[k].harmless][:POOL]
        parts = [k for k in ranked if self.effects[k].harmless][:SHORTLIST]
        return sorted({*faults, *parts, *best})
