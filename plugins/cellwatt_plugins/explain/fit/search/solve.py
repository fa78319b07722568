"""The fit of given terms: least squares, repeated until noise and fitted torque are consistent with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.robot.blocks import Regression

CACHED = 6
"""Number of cached solutions: each term is left out repeatedly, and tried beside the same others."""


def solve(state: SearchState, terms: Sequence[Term]) -> Solution:
    """Fit terms; effects that depend on torque use the torque of this fit."""
    key = tuple(terms)
    if key not in state.solved:
        state.solved[key] = fitted(state.problem, terms)
        while len(state.solved) > CACHED:
            del state.solved[next(iter(state.solved))]
    return replace(state.solved[key], terms=list(terms))


def fitted(problem: Problem, terms: Sequence[Term]) -> Solution:
    """Fit terms to a problem, outside a search."""
    # Columns that depend on the motion alone are the same for every fitted torque.
    steady = all(t.effect.by_motion_alone for t in terms)
    rounds = 2 if steady or all(t.effect.mechanical for t in terms) else 3
    factor: Float | None = None
    for remaining in reversed(range(rounds)):
        fit = problem.fit([problem.block(t) for t in terms], factor)
        factor = problem.noise_factor(fit.residual)
        if not (steady and remaining):
            problem = _with_fitted_torque(problem, terms, fit)
    fit = problem.fit([problem.block(t) for t in terms], factor)
    return Solution(problem, list(terms), fit, problem.noise_factor(fit.residual))


def without(state: SearchState, now: Solution, term: Term) -> Solution:
    """The solution without ``term``."""
    return solve(state, [t for t in now.terms if t is not term])


def reweigh(state: SearchState, now: Solution) -> Solution:
    """The same terms, with samples near stops weighted for the friction and the delay that the terms add."""
    turning, late, terms = np.zeros_like(state.turning), 0.0, now.terms
    for term in now.terms:
        if term.effect.form.reverses and term.joint is not None:
            turning[term.joint] += abs(float(now.coefficients(term)[0]))
        if term.effect.name == "time_delay" and term.effect.acts_on == "reading":
            late = term.shape[0] * float(now.coefficients(term)[0])
    step = now.problem.states[0].step
    if np.all(np.abs(turning - state.turning) < 0.1 * turning + 1e-12) and abs(late - state.late) < step:
        return now
    # Near stops, a delay was not distinguished from torque that reverses slowly.
    if abs(late - state.late) >= step:
        terms = [replace(t, shape=(late,)) if t.effect.name == "time_delay" else t for t in terms]
    state.turn(turning, late)
    return solve(state, terms)


def _with_fitted_torque(problem: Problem, terms: Sequence[Term], fit: Regression) -> Problem:
    if problem.side == "supply":
        return problem
    mechanical = [
        (term, fit.coefficients[place]) for term, place in zip(terms, fit.slices, strict=True) if term.effect.mechanical
    ]
    nuisance = fit.coefficients[: problem.design.size]
    return problem.with_torque(*problem.course(nuisance, mechanical))
