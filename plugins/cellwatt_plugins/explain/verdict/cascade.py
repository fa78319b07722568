"""From the user's simulation to the model, step by step: the error on data left out that each finding removes."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.leave_out import LeaveOut
from cellwatt_plugins.explain.fit.problem import Place, Problem, Term, title
from cellwatt_plugins.explain.fit.retuning import all_fixed, freed
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.verdict.findings import Step, StepKind
from cellwatt_plugins.robot.curves import Curve

LEAST = 0.01
"""Smallest error of a channel, in units of the noise, that enters the mean."""


@dataclass(frozen=True)
class Added:
    """A term that is added, with the rms error (C,) of its side before and after."""

    term: Term
    before: Float
    after: Float
    drop: float
    """Decrease of the mean square error by the term, in units of the noise, summed over the channels."""

    @property
    def curve(self) -> bool:
        """True for a curve of unknown law."""
        return isinstance(self.term.effect, Curve)


@dataclass(frozen=True)
class Falling:
    """The errors (C,) of one side from the simulation with the user's parameters to the model."""

    problem: Problem
    simulation: Float
    added: tuple[Added, ...]
    """Laws, the largest first, then curves."""
    model: Float
    """With the nominal parameters retuned as well."""

    @property
    def untuned(self) -> Float:
        """Error with all terms, before the nominal parameters are retuned."""
        return self.added[-1].after if self.added else self.simulation


def falling(solution: Solution) -> Falling:
    """The errors of one side on data left out; coefficients are fitted without each fold, nominal parameters are
    fixed."""
    best = solution.best
    steady = [t for t in best.terms if not t.effect.form.intermittent]
    # Intermittent effects cannot be tested on data left out: their fitted contributions are subtracted.
    once = {t.place: best.added(t) for t in _once(best)}
    fixed = LeaveOut(freed(best.problem, all_fixed(best.problem)), best.factor)
    free = LeaveOut(best.problem, best.factor)
    floor = best.problem.floor

    def error(held: LeaveOut, terms: Sequence[Term]) -> Float:
        gone = sum((once[t.place] for t in terms if t.place in once), start=np.zeros(1))
        return best.problem.rms(held.residual([t for t in terms if t.place not in once]) - gone)

    before, chosen, out = error(fixed, []), list[Term](), list[Added]()
    laws = _largest_first(fixed, best, [t for t in steady if not isinstance(t.effect, Curve)], once)
    for term in [*laws, *(t for t in steady if isinstance(t.effect, Curve))]:
        chosen.append(term)
        after = error(fixed, chosen)
        out.append(Added(term, before, after, float(np.sum(np.square(before / floor) - np.square(after / floor)))))
        before = after
    return Falling(best.problem, best.problem.rms(best.problem.design.target), tuple(out), error(free, best.terms))


def _once(solution: Solution) -> list[Term]:
    return [t for t in solution.terms if t.effect.form.intermittent]


def _largest_first(
    held: LeaveOut, solution: Solution, steady: Sequence[Term], once: Mapping[Place, Float]
) -> list[Term]:
    """Laws in order of the summed square error that each removes beside those before it."""
    root = solution.problem.design.root
    pushes = sorted(
        ((float(np.sum(np.square(once[t.place] * root))), i) for i, t in enumerate(_once(solution))), reverse=True
    )
    remaining, chosen, order = list(steady), list[Term](), list[Term]()
    error = float(np.sum(held.errors([])))
    while remaining or pushes:
        rest = [float(np.sum(held.errors([*chosen, t]))) for t in remaining]
        best = int(np.argmin(rest)) if rest else -1
        if pushes and (best < 0 or pushes[0][0] > error - rest[best]):
            order.append(_once(solution)[pushes.pop(0)[1]])
            continue
        error = rest[best]
        chosen.append(remaining.pop(best))
        order.append(chosen[-1])
    return order


def cascade(sides: Sequence[Falling], mounted: Float | None) -> tuple[Step, ...]:
    """The steps of all sides, largest first; curves and retuned parameters last.

    ``mounted`` (C,) are the torque errors in the simulation's gravity, if the real mount differs.
    """
    errors = {(i, c): float(side.simulation[c]) for i, side in enumerate(sides) for c in side.problem.observed}
    floors = {(i, c): float(side.problem.floor[c]) for i, side in enumerate(sides) for c in side.problem.observed}

    def step(kind: StepKind, label: str, effect: str = "", joint: int | None = None, held_out: bool = True) -> Step:
        ratios = [max(errors[at] / floors[at], LEAST) for at in errors]
        total = float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0
        named = {sides[i].problem.channel(c)[0]: value for (i, c), value in errors.items()}
        return Step(kind, label, effect, joint, total, named, held_out)

    def put(i: int, values: Float) -> None:
        errors.update({(i, c): float(values[c]) for c in sides[i].problem.observed})

    if mounted is not None:
        put(0, mounted)
    steps = [step("simulation", "your simulation", held_out=False)]
    if mounted is not None:
        put(0, sides[0].simulation)
        steps.append(step("finding", "mount of the base", "gravity_tilt", held_out=False))
    parts = [[(i, added) for added in side.added] for i, side in enumerate(sides)]
    for i, added in heapq.merge(*parts, key=lambda pair: (pair[1].curve, -pair[1].drop)):
        put(i, added.after)
        term, held_out = added.term, not added.term.effect.form.intermittent
        steps.append(step("curve" if added.curve else "finding", title(term), term.effect.name, term.number, held_out))
    for i, side in enumerate(sides):
        put(i, side.model)
    return (*steps, step("retuning", "your numbers retuned"))
