"""Which effects are there: the set of terms with the greatest evidence, found step by step.

Forward: of all candidate terms the one that adds most evidence enters, and all shapes are refined. Then each term is
tried against every other name (swap) and against nothing (drop). Nominal parameters are free throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.effects import EFFECTS
from cellwatt_plugins.mismatch.effects.effect import Effect, Shape
from cellwatt_plugins.mismatch.fit.belief import (
    blurred,
    holds,
    physical,
    refused,
    relieves,
    seen_by_several,
    usual,
)
from cellwatt_plugins.mismatch.fit.problem import Problem, Term
from cellwatt_plugins.mismatch.fit.refinement import climb
from cellwatt_plugins.mismatch.fit.shaken import remaining
from cellwatt_plugins.mismatch.fit.solution import DEFAULT, Candidate, Solution, Thresholds, Trial
from cellwatt_plugins.robot.law import column
from cellwatt_plugins.robot.regression import Block, Regression

Float = NDArray[np.float64]


ROUNDS = 4
"""Times that a schedule is found anew with the coefficients that the last one gave."""
EXCESS = 0.35
"""Mean square residual beyond noise, in units of the noise, that is much."""


def search(
    make: Callable[[Float], Problem],
    channels: int,
    thresholds: Thresholds = DEFAULT,
    effects: Sequence[Effect] = EFFECTS,
) -> Solution:
    """The terms of one side that the data ask for.

    ``make`` gives the problem for friction (C,) Nm beyond the nominal that turns over with the velocity's sign.
    """
    return _Search(make, channels, thresholds, effects).run()


class _Search:
    def __init__(
        self, make: Callable[[Float], Problem], channels: int, thresholds: Thresholds, effects: Sequence[Effect]
    ) -> None:
        self.make, self.turning = make, np.zeros(channels)
        self.start, self.thresholds = make(self.turning), thresholds
        supply = self.start.side == "supply"
        self.effects = [e for e in effects if (e.place == "supply") == supply]
        self.kept: dict[tuple[str, int | None], list[Block]] = {}
        self.tried: dict[tuple[str, int | None], Trial] = {}

    def run(self) -> Solution:
        now = self._solve([])
        while len(now.terms) < self.thresholds.most:
            entered = self._enter(now)
            if entered is None:
                break
            now = self._drop(self._swap(self._reweighed(entered)))
        for term in now.terms[:-1]:
            now = self._refined(now, term)
        now = self._lasting(self._credible(self._sizeable(self._drop(now, keep=0))))
        now.rivals = {term.place: self._compared(now, term) for term in now.terms}
        refused = [t for place, t in self.tried.items() if place not in {term.place for term in now.terms}]
        now.tried = [self._kept(now, term) for term in now.terms] + sorted(refused, key=lambda t: -t.gain)
        return now

    def _reweighed(self, now: Solution) -> Solution:
        """The same terms where friction that they add makes the samples near stops count less."""
        turning = np.zeros_like(self.turning)
        for term in now.terms:
            if term.effect.turns_over and term.joint is not None:
                turning[term.joint] += abs(float(now.fit.coefficients[now.block(term)[1]][0]))
        if np.all(np.abs(turning - self.turning) < 0.1 * turning + 1e-12):
            return now
        self.turning, self.start = turning, self.make(turning)
        self.kept.clear()
        return self._solve(now.terms)

    def _solve(self, terms: list[Term], refine: Sequence[Term] = ()) -> Solution:
        """Fit terms; torque effects that act on the measured torque see the torque of this fit."""
        problem = self.start
        factor: Float | None = None
        for _ in range(3 if any(t.effect.after for t in terms) else 2):
            blocks = [problem.block(t) for t in terms]
            fit = problem.fit(blocks, factor)
            factor = problem.factor(fit.residual) * np.maximum(problem.chi2(fit.residual), 1.0)
            problem = self._with_fitted(problem, terms, fit)
        blocks = [problem.block(t) for t in terms]
        fit = problem.fit(blocks, factor)
        # What is unexplained yet counts as noise: an effect is judged by the share that it explains.
        factor = problem.factor(fit.residual) * np.maximum(problem.chi2(fit.residual), 1.0)
        solution = Solution(problem, list(terms), fit, factor)
        for term in refine:
            solution = self._refined(solution, term)
        return solution

    def _with_fitted(self, problem: Problem, terms: Sequence[Term], fit: Regression) -> Problem:
        if problem.side == "supply":
            return problem
        mechanical = [
            (term, fit.coefficients[place])
            for term, place in zip(terms, fit.slices, strict=True)
            if not term.effect.after
        ]
        nuisance = fit.coefficients[: problem.design.size]
        return problem.with_torque(problem.course(nuisance, mechanical), problem.carried(nuisance, mechanical))

    def _candidates(self, now: Solution, at: int | None = None) -> list[Candidate]:
        """Best shape of every effect at every place, beside the terms already there; only ``at`` a joint if given."""
        problem, residual = now.problem, now.problem.every_sample(now.residual)
        chi2 = problem.fast_chi2(now.residual)
        best: dict[tuple[str, int | None], Candidate] = {}
        for effect in self.effects:
            for joint in self._places(effect):
                elsewhere = at is not None and joint is not None and joint != at
                if elsewhere or self._there(effect, joint, now.terms) or not self._worthwhile(effect, joint, chi2):
                    continue
                if effect.shapes_friction and not self._rubs(joint, now.terms):
                    continue
                shapes = effect.shapes(problem.states, joint, residual)
                if not shapes:
                    continue
                found = self._best_shape(now, effect, joint, shapes)
                if found is not None:
                    best[(effect.name, joint)] = found
        return sorted(best.values(), key=lambda c: -c.gain - c.term.effect.plainer)

    def _best_shape(
        self, now: Solution, effect: Effect, joint: int | None, shapes: Sequence[Shape]
    ) -> Candidate | None:
        states, robot = now.problem.states, now.problem.states[0].robot
        terms = [Term(effect, joint, shape) for shape in shapes if effect.resolved(states, joint, shape)]
        if not terms:
            return None
        blocks = self._blocks(now.problem, effect, joint, terms)
        lasting = not (effect.after or effect.varies or effect.by_load)
        gains = now.fit.gains(blocks, keep=lasting)
        found = [
            Candidate(term, gain - effect.charge(now.problem.states, term.shape), coefficients)
            for term, block, (gain, coefficients) in zip(terms, blocks, gains, strict=True)
            if physical(term, coefficients, robot) and usual(term, coefficients, block.prior)
        ]
        return max(found, key=lambda c: c.gain, default=None)

    def _blocks(self, problem: Problem, effect: Effect, joint: int | None, terms: Sequence[Term]) -> list[Block]:
        """Blocks of all shapes of an effect; made once where they depend on the motion alone."""
        key = (effect.name, joint)
        if key in self.kept:
            return self.kept[key]
        per_run = [effect.grid(s, joint, [t.shape for t in terms]) for s in problem.states]
        blocks = [problem.prior_block(t, problem.stack([run[i] for run in per_run])) for i, t in enumerate(terms)]
        if not (effect.after or effect.varies or effect.by_load):
            self.kept[key] = blocks
        return blocks

    def _places(self, effect: Effect) -> list[int | None]:
        states = self.start.states
        longest = max(float(s.time[-1] - s.time[0]) for s in states)
        if longest < effect.least_time:
            return []
        places: list[int | None] = list(range(states[0].body.joints)) if effect.place == "joint" else [None]
        return [joint for joint in places if effect.possible(states[0].robot, joint)]

    @staticmethod
    def _there(effect: Effect, joint: int | None, terms: Sequence[Term]) -> bool:
        return any(
            t.joint == joint and (t.effect is effect or (effect.family and t.effect.family == effect.family))
            for t in terms
        )

    def _rubs(self, joint: int | None, terms: Sequence[Term]) -> bool:
        """Whether there is Coulomb friction that an effect could change."""
        described = column(self.start.states[0].robot, "coulomb_friction")[joint or 0]
        return bool(described > 0) or any(t.place == ("coulomb_friction", joint) for t in terms)

    def _worthwhile(self, effect: Effect, joint: int | None, chi2: Float) -> bool:
        return not effect.costly or joint is None or bool(chi2[joint] > self.thresholds.costly)

    def _enter(self, now: Solution) -> Solution | None:
        """The solution with the best new term; None where none is believed."""
        for candidate in self._candidates(now)[:6]:
            if candidate.gain < self._asked(candidate.term):
                self._note(candidate.term, candidate.gain, "adds too little evidence")
                continue
            new = self._solve([*now.terms, candidate.term], refine=[candidate.term])
            if (like := blurred(now, new, self.thresholds.blur)) is not None:
                if (instead := self._instead(now, like, new.terms[-1])) is not None:
                    return instead
                why: str | None = f"cannot be told from {like.effect.name.replace('_', ' ')} in these recordings"
            else:
                why = refused(now, new, self.thresholds)
            if why is None:
                return new
            self._note(candidate.term, candidate.gain, why)
        return None

    def _asked(self, term: Term) -> float:
        """nats that a term must add; half of what is no rare thing, as a plain parameter that is described as 0."""
        described = term.effect.described(self.start.states[0].robot, term.joint)
        ordinary = term.effect.ordinary or (bool(term.effect.nominal) and described == 0)
        return 0.5 * self.thresholds.gain if ordinary else self.thresholds.gain

    def _instead(self, now: Solution, old: Term, new: Term) -> Solution | None:
        """The solution with a new term in an old one's place; None where the old one has more evidence."""
        others = [t for t in now.terms if t is not old]
        without = self._solve(others)
        own = without.fit.gain(without.problem.block(old))[0] + old.effect.plainer
        if without.fit.gain(without.problem.block(new))[0] + new.effect.plainer < own + 3:
            return None
        self._note(old, own, f"{new.effect.name} explains it better")
        return self._solve([*others, new])

    def _swap(self, now: Solution) -> Solution:
        """Each term under the name that explains it best, the others held."""
        for term in list(now.terms):
            others = [t for t in now.terms if t is not term]
            without = self._solve(others)
            own = without.fit.gain(without.problem.block(term))[0]
            for rival in self._candidates(without, at=term.joint)[:3]:
                ahead = rival.term.effect.plainer - term.effect.plainer
                if rival.term.place == term.place or rival.gain + ahead < own - 3:
                    continue
                new = self._solve([*others, rival.term], refine=[rival.term])
                gain = without.fit.gain(new.problem.block(new.terms[-1]))[0]
                if gain + ahead > own + 3:
                    self._note(term, own, f"{new.terms[-1].effect.name} explains it better")
                    now, own = new, gain
        return now

    def _sizeable(self, now: Solution) -> Solution:
        """Without the terms that add less than the form of another one there may be wrong by."""
        for term in list(now.terms):
            doubt = {t.effect.name: t.effect.inexact * self._share(now, t) for t in now.terms if t is not term}
            name = max(doubt, key=lambda n: doubt[n], default="")
            if name and self._share(now, term) < doubt[name]:
                self._note(term, 0.0, f"is less than the form of {name.replace('_', ' ')} may be wrong by")
                now = self._solve([t for t in now.terms if t is not term])
        return now

    def _credible(self, now: Solution) -> Solution:
        """Without the terms of a joint that explain little of what differs there: they only lean on the unknown."""
        left = remaining(now)
        for term in list(now.terms):
            if term.joint is None or term.effect.costly or left[term.joint] - 1 < EXCESS:
                continue
            without = self._solve([t for t in now.terms if t is not term])
            drop = float(remaining(without)[term.joint] - left[term.joint])
            share = drop / (drop + float(left[term.joint]) - 1)
            if share < self.thresholds.credible:
                self._note(
                    term, now.rivals.get(term.place, (0.0, ()))[0], f"explains {100 * share:.0f} % of what differs"
                )
                now = without
        return now

    def _lasting(self, now: Solution) -> Solution:
        """Without the terms that, beside the later ones, no longer show on data left out or in several channels."""
        for term in sorted(now.terms, key=lambda t: self._share(now, t)):
            if term.effect.scheduled or term.effect.costly:
                continue
            without = self._solve([t for t in now.terms if t is not term])
            last = self._solve([*without.terms, term])
            if term.effect.everywhere and not seen_by_several(without, last.block(term)[0]):
                why = "beside the others only one channel asks for it"
            elif relieves(without, last, self.thresholds) or holds(without, last, self.thresholds):
                continue
            else:
                why = "beside the others it hardly lowers the error on data left out"
            self._note(term, without.fit.gain(without.problem.block(term))[0], why)
            now = without
        return now

    @staticmethod
    def _share(now: Solution, term: Term) -> float:
        """Size of what a term adds, in units of the noise."""
        block, place = now.block(term)
        added = block.times(now.fit.coefficients[place], len(now.problem.floor)) / now.problem.floor
        return float(np.sqrt(np.mean(np.square(added))))

    def _compared(self, now: Solution, term: Term) -> tuple[float, tuple[Candidate, ...]]:
        """Evidence of a term beside the others, and the three names that come nearest in its place."""
        without = self._solve([t for t in now.terms if t is not term])
        own = without.fit.gain(without.problem.block(term))[0]
        rivals = [c for c in self._candidates(without, at=term.joint) if c.term.place != term.place]
        return own, tuple(rivals[:3])

    @staticmethod
    def _kept(now: Solution, term: Term) -> Trial:
        gain, rivals = now.rivals[term.place]
        joint = None if term.joint is None else term.joint + 1
        best = f"{rivals[0].term.effect.name} in its place: {rivals[0].gain:.0f}" if rivals else "no other name fits"
        return Trial(term.effect.name, joint, float(gain), True, best)

    def _drop(self, now: Solution, keep: int = 1) -> Solution:
        """Terms that the later ones made needless leave; the last ``keep`` stay."""
        for term in list(now.terms[: len(now.terms) - keep]):
            others = [t for t in now.terms if t is not term]
            rubbing = [t for t in others if t.joint == term.joint and t.effect.shapes_friction]
            if rubbing and not self._rubs(term.joint, others):
                continue
            without = self._solve([t for t in now.terms if t is not term])
            gain = without.fit.gain(now.problem.block(term))[0]
            if gain < self._asked(term):
                self._note(term, gain, "needless beside the others")
                now = without
        return now

    def _refined(self, now: Solution, term: Term) -> Solution:
        """Shape of one term where the evidence is greatest, the other terms held."""
        for _ in range(ROUNDS):
            again = self._reshaped(now, term)
            if again is None:
                break
            now, term = again
        bounds = term.effect.bounds(term.shape)
        if not bounds:
            return now
        others = self._solve([t for t in now.terms if t is not term])
        problem, robot = now.problem, now.problem.states[0].robot

        def evidence(shape: Shape) -> float:
            if not term.effect.resolved(problem.states, term.joint, shape):
                return -np.inf
            gain, mean = others.fit.gain(problem.block(replace(term, shape=shape)))
            return gain - term.effect.charge(problem.states, shape) if physical(term, mean, robot) else -np.inf

        shape = climb(evidence, term.shape, bounds)
        if shape == term.shape:
            return now
        return self._solve([replace(t, shape=shape) if t is term else t for t in now.terms])

    def _reshaped(self, now: Solution, term: Term) -> tuple[Solution, Term] | None:
        """The solution with the shape anew that a term's own coefficients ask for; None where it is no better."""
        block, place = now.block(term)
        own = now.fit.coefficients[place]
        course = now.residual + block.times(own, len(now.problem.floor))
        states = now.problem.states
        shape = term.effect.reshaped(states, term.joint, now.problem.every_sample(course), own)
        if shape is None or shape == term.shape:
            return None
        without = self._solve([t for t in now.terms if t is not term])
        new = replace(term, shape=shape)
        old_gain, new_gain = (
            without.fit.gain(without.problem.block(t))[0] - t.effect.charge(states, t.shape) for t in (term, new)
        )
        if new_gain <= old_gain:
            return None
        return self._solve([new if t is term else t for t in now.terms]), new

    def _note(self, term: Term, gain: float, why: str) -> None:
        joint = None if term.joint is None else term.joint + 1
        self.tried[term.place] = Trial(term.effect.name, joint, float(gain), False, why)
