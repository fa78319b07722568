"""Links that swing on a spring or fall through a gap: no model follows them down to the noise."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.solution import Solution

FELT = 0.3
"""Share of a channel's noise floor above which an effect is visible in the channel."""

FEW = 0.02
"""Smallest share of the samples without swinging links from which the residual at rest can be judged."""


def swinging_torque(solution: Solution) -> Float:
    """Sum (N, C) of the effects that are simulated sample by sample; 0 if there are none."""
    swinging = (solution.added(term) for term in solution.terms if term.effect.form.sample_by_sample)
    return sum(swinging, start=np.zeros_like(solution.residual))


def swinging_channels(solution: Solution) -> set[int]:
    """Channels in which such effects are visible over the whole recording."""
    size = np.sqrt(np.mean(np.square(swinging_torque(solution)), axis=0)) / solution.problem.floor
    return {int(channel) for channel in np.flatnonzero(size > FELT)}


def remaining_chi2(solution: Solution) -> Float:
    """Mean square residual (C,), in units of its variance, or of the bare noise where a neighbour swings.

    The uncertainty of the motion near stops must not hide the effect of the swinging.
    """
    problem = solution.problem
    out = problem.chi2(solution.residual)
    own = {term.joint for term in solution.terms if term.effect.form.sample_by_sample}
    for channel in swinging_channels(solution) - own:
        bare = float(np.mean(np.square(solution.residual[:, channel]))) / problem.floor[channel] ** 2
        out[channel] = max(out[channel], bare)
    return out


def chi2_at_rest(solution: Solution) -> Float:
    """Mean square residual (C,), in units of its variance, over the samples at which no link swings or falls through.

    Infinite if there are too few such samples for a judgement.
    """
    problem = solution.problem
    at_rest = np.ones(len(solution.residual), np.bool_)
    for term in solution.terms:
        if term.effect.form.sample_by_sample:
            # Compared at unit coefficient: rebounds that the model does not follow make the coefficient small.
            own = solution.block(term)[0].columns[:, term.joint, 0]
            at_rest &= np.abs(own) < FELT * problem.floor[term.joint]
    if np.mean(at_rest) < FEW:
        return np.full(len(problem.floor), np.inf)
    return np.asarray(np.mean(np.square(solution.residual * problem.design.root)[at_rest], axis=0))


def confirmed_share(problem: Problem, term: Term, coefficients: Float, residual: Float) -> float:
    """Share of a simulated effect that runs left out confirm, 0 to 1, less its standard error.

    For each run the shape is chosen anew by the other runs; ``residual`` (N, C) is that of the fit with the term. 1 for
    a single run.
    """
    joint = term.joint or 0
    residuals = problem.every_sample(residual)
    if len(residuals) < 2:
        return 1.0
    added = problem.torques(term, coefficients)
    course = [part[:, joint] + more[:, joint] for part, more in zip(residuals, added, strict=True)]
    shapes = [term.shape, *term.effect.shapes(problem.states, term.joint, residuals)]
    tried = [np.concatenate(term.effect.grid(s, term.joint, shapes), axis=1) for s in problem.states]
    pull = np.stack([columns.T @ part for columns, part in zip(tried, course, strict=True)])
    size = np.stack([np.sum(columns**2, axis=0) for columns in tried])
    met, made = np.zeros(len(residuals)), np.zeros(len(residuals))
    for run in range(len(residuals)):
        others = np.arange(len(residuals)) != run
        drop = np.maximum(pull[others].sum(0), 0.0) ** 2 / np.maximum(size[others].sum(0), 1e-12)
        best = int(np.argmax(drop))
        met[run], made[run] = pull[run, best], size[run, best]
    share, spread = _ratio(met, made)
    return float(np.clip((share - spread) / coefficients[0], 0.0, 1.0))


def _ratio(above: Float, below: Float) -> tuple[float, float]:
    """Ratio of two sums over the runs, and its standard error: jackknife (Efron 1982)."""
    count = len(above)
    without = (np.sum(above) - above) / np.maximum(np.sum(below) - below, 1e-12)
    spread = np.sqrt((count - 1) / count * np.sum(np.square(without - np.mean(without))))
    return float(np.sum(above) / max(float(np.sum(below)), 1e-12)), float(spread)
