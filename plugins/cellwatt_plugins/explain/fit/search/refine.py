"""Refinement of one term's shape, with the other terms fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellwatt_plugins.explain.fit.acceptance import physical
from cellwatt_plugins.explain.fit.coordinate_search import climb
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.solve import solve, without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.robot.effects.effect import Shape

ROUNDS = 4
"""Largest number of times that a shape is derived again from the coefficients of the last fit."""


def refine(state: SearchState, now: Solution, term: Term) -> Solution:
    """The solution with the shape of greatest evidence for a term."""
    for _ in range(ROUNDS):
        again = _reshaped(state, now, term)
        if again is None:
            break
        now, term = again
    bounds = term.effect.bounds(term.shape)
    if not bounds:
        return now
    others = without(state, now, term)
    problem = now.problem

    def evidence(shape: Shape) -> float:
        if not term.effect.resolved(problem.states, term.joint, shape):
            return -np.inf
        gain, mean = others.fit.gain(problem.block(replace(term, shape=shape)))
        return gain - term.effect.charge(problem.states, shape) if physical(term, mean, state.robot) else -np.inf

    shape = climb(evidence, term.shape, bounds)
    best = max(term.effect.fuller(problem.states, term.joint, shape), key=evidence, default=shape)
    if evidence(best) > evidence(shape):
        shape = climb(evidence, best, term.effect.bounds(best))
    return now if shape == term.shape else _with_shape(state, now, term, shape)[0]


def _reshaped(state: SearchState, now: Solution, term: Term) -> tuple[Solution, Term] | None:
    """The solution with a new shape derived from the term's own coefficients; None if it is no better."""
    own, states = now.coefficients(term), now.problem.states
    course = now.residual + now.added(term)
    shape = term.effect.reshaped(states, term.joint, now.problem.every_sample(course), own)
    if shape is None or shape == term.shape:
        return None
    others = without(state, now, term)
    old, new = (
        others.fit.gain(others.problem.block(t))[0] - t.effect.charge(states, t.shape)
        for t in (term, replace(term, shape=shape))
    )
    return _with_shape(state, now, term, shape) if new > old else None


def _with_shape(state: SearchState, now: Solution, term: Term, shape: Shape) -> tuple[Solution, Term]:
    new = replace(term, shape=shape)
    return solve(state, [new if t is term else t for t in now.terms]), new
