"""The few effects that explain a residual best: at most a part of another weight and two faults."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.effects import Effect, joint_effects, part_effects, warm_up
from cellwatt_plugins.faults.cycles.evidence import Fit, Gram, fit, gram
from cellwatt_plugins.faults.cycles.identify import Arm
from cellwatt_plugins.faults.cycles.readings import Reading
from cellwatt_plugins.faults.cycles.samples import Samples

Float = NDArray[np.float64]
Columns = NDArray[np.intp]

WARM = 0.15
"""Share by which friction of all joints may be higher or lower (one sigma)."""
FAULT_ODDS = 7.0
"""Natural logarithm of the odds against any one fault in a cycle …"""
PART_ODDS = 6.0
"""… and against a part of another weight, held in certain moves."""
MOST_FAULTS = 2
ROUNDS = 3
EFFECT_DOUBT = 0.03
COPPER_DOUBT = 0.15
"""Shares of a fault's power, and of its copper loss, by which the model may misjudge it (one sigma)."""
SHORTLIST = 3
"""So many readings of the part are tried together with faults."""


@dataclass(frozen=True)
class Answer:
    """The best explanation in one reading.

    ``effects`` with their ``sizes``; ``score``, its log odds up to a constant of the cycle; ``rivals`` one a fault
    among the effects: log odds of each joint (0-based) in its place, and of none (-1); ``misfit`` what is left
    unexplained, as variance relative to the noise's.
    """

    reading: Reading
    effects: tuple[Effect, ...]
    sizes: tuple[Float, ...]
    score: float
    rivals: tuple[dict[int, float], ...]
    misfit: float


def explain(arm: Arm, samples: Samples, reading: Reading, inside: Float) -> Answer:
    """Explain what is left in one reading; ``inside`` (N, M + 1) says after which moves' starts each sample lies.

    Copper loss grows with the square of torque: what an effect adds by it is taken off, and all is fitted again.
    """
    effects = [
        e for j in range(arm.body.joints) if j not in reading.stopped for e in joint_effects(arm, reading.load, j)
    ]
    effects += part_effects(arm, reading.load, inside)
    shared = [samples.harmless, reading.doubt, WARM * warm_up(arm.parameters, reading.load)[:, None]]
    answer = _linear(effects, reading, reading.residual, samples.sigma, np.column_stack(shared))
    for _ in range(ROUNDS):
        square, doubt = _squared(arm.parameters, answer)
        if not doubt.size:
            break
        harmless = np.column_stack([*shared, doubt])
        answer = _linear(effects, reading, reading.residual - square, samples.sigma, harmless)
    return answer


def _linear(effects: Sequence[Effect], reading: Reading, residual: Float, sigma: Float, harmless: Float) -> Answer:
    """The best set of effects for a residual (N,)."""
    products = gram(residual, np.column_stack([effect.columns for effect in effects]), sigma, harmless)
    search = _Search(effects, products, MOST_FAULTS - len(reading.stopped))
    best: tuple[int, ...] = ()
    while (better := search.extended(best)) is not None:
        best = better
    cuts: list[int] = np.cumsum([effects[k].columns.shape[1] for k in best])[:-1].tolist()
    return Answer(
        reading=reading,
        effects=tuple(effects[k] for k in best),
        sizes=tuple(np.split(search.fit(best).sizes, cuts)) if best else (),
        score=search.score(best) + _likelihood(products, sigma, harmless),
        rivals=tuple(search.rivals(best, k) for k in best if not effects[k].harmless),
        misfit=search.misfit(best) / max(1, len(residual)),
    )


def _squared(parameters: Parameters, answer: Answer) -> tuple[Float, Float]:
    """Power (N,) W of the squares of the answer's torques, and columns (N, k) of what the model may miss in it."""
    load = answer.reading.load
    square = np.zeros(len(load.power))
    doubt = [np.empty((len(square), 0))]
    for effect, sizes in zip(answer.effects, answer.sizes, strict=True):
        watts = effect.columns @ sizes
        if effect.joint is None or effect.torque is None:
            continue
        more = effect.torque @ sizes
        copper = load.gain * parameters.copper[effect.joint]
        square += copper * more**2
        losses = copper * (2 * load.torque[:, effect.joint] + more) * more
        doubt.append(np.column_stack([EFFECT_DOUBT * watts, COPPER_DOUBT * losses]))
    return square, np.column_stack(doubt)


def _likelihood(products: Gram, sigma: Float, harmless: Float) -> float:
    """Log likelihood without any effect, up to a constant of the cycle."""
    scaled = harmless / sigma[:, None]
    return -0.5 * products.misfit - 0.5 * float(np.linalg.slogdet(np.eye(scaled.shape[1]) + scaled.T @ scaled)[1])


class _Search:
    """Sets of effects, as sorted indices, compared by evidence and prior odds; ``room`` for so many faults."""

    def __init__(self, effects: Sequence[Effect], products: Gram, room: int) -> None:
        self.effects, self.products, self.room = effects, products, room
        ends = np.cumsum([e.columns.shape[1] for e in effects])
        self._columns = [np.arange(end - e.columns.shape[1], end) for e, end in zip(effects, ends, strict=True)]

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Evidence and sizes of a set."""
        if not chosen:
            return Fit(0.0, np.empty(0), np.empty(0))
        return fit(self.products, np.concatenate([self._columns[k] for k in chosen]))

    def misfit(self, chosen: Sequence[int]) -> float:
        """Sum of squares, in standard deviations, that a set leaves."""
        columns = np.concatenate([self._columns[k] for k in chosen]) if chosen else np.empty(0, np.intp)
        sizes, inner = self.fit(chosen).sizes, self.products.inner[np.ix_(columns, columns)]
        return self.products.misfit - float(2 * self.products.pull[columns] @ sizes - sizes @ inner @ sizes)

    def score(self, chosen: Sequence[int]) -> float:
        """Log odds over no effect at all; minus infinity where a size has the wrong sign."""
        found = self.fit(chosen)
        begin = 0
        for k in chosen:
            width = len(self._columns[k])
            if not self.effects[k].sensible(found.sizes[begin : begin + width]):
                return -math.inf
            begin += width
        return found.gain - sum(PART_ODDS if self.effects[k].harmless else FAULT_ODDS for k in chosen)

    def extended(self, best: Sequence[int]) -> tuple[int, ...] | None:
        """The best set with one effect more, if it beats ``best``; of two, the first may be another than before."""
        pool = range(len(self.effects)) if not best else self._shortlist(best)
        sets = combinations(pool, len(best) + 1) if len(best) < 2 else [(*best, k) for k in pool if k not in best]
        scored = [(self.score(chosen), chosen) for chosen in sets if self._allowed(chosen)]
        top = max(scored, default=(-math.inf, ()))
        return tuple(top[1]) if top[0] > self.score(best) else None

    def rivals(self, best: Sequence[int], blamed: int) -> dict[int, float]:
        """Log odds of each joint in the place of one effect of ``best``; of none under -1."""
        others = [k for k in best if k != blamed]
        out = {-1: self.score(others)}
        for k, effect in enumerate(self.effects):
            if effect.joint is not None and self._allowed((*others, k)):
                out[effect.joint] = max(out.get(effect.joint, -math.inf), self.score([*others, k]))
        return out

    def _allowed(self, chosen: Sequence[int]) -> bool:
        joints = [j for k in chosen if (j := self.effects[k].joint) is not None]
        parts = len(chosen) - len(joints)
        return len(joints) <= self.room and len(set(joints)) == len(joints) and parts <= 1

    def _shortlist(self, best: Sequence[int]) -> list[int]:
        """All faults, and the readings of the part that do best beside the faults already chosen."""
        faults = [k for k in best if not self.effects[k].harmless]
        parts = [k for k, effect in enumerate(self.effects) if effect.harmless]
        parts.sort(key=lambda k: self.fit([*faults, k]).gain, reverse=True)
        return sorted({*(k for k, e in enumerate(self.effects) if not e.harmless), *parts[:SHORTLIST], *best})
