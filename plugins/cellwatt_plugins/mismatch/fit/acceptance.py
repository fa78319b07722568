"""Acceptance of a term: what it must explain, show on data left out, and be told apart from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.coordinate_search import at_bound
from cellwatt_plugins.mismatch.fit.cross_validation import CrossValidation, rms
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.solution import Solution, Thresholds
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.possible import impossible
from cellwatt_plugins.robot.regression import Prior

Float = NDArray[np.float64]

SEVERAL = 3.0
"""nats that all channels but the one that asks most must give for what concerns the whole recording."""
BARELY = 0.97
"""A shape that would not be resolved were it so much smaller is at the end of what can be."""
AGAINST = 0.3
"""Share of their evidence that other channels may give for the contrary of what concerns the whole recording."""
RISE = 1.001
"""Factor on a held-out error that is a rise."""
SMALLEST = 0.2
"""Of the supply's noise that a term must change its power by."""
STEADY = 2.5
"""Standard errors by which the error on blocks left out must fall on average, near the noise."""
OFF_SCALE = 0.35
"""Largest distance from 1 of the coefficient of an effect that is simulated to scale."""


def required_gain(term: Term, robot: RobotDescription, thresholds: Thresholds) -> float:
    """nats that a term must add; half of it for no rare thing, as a plain parameter that is described as 0."""
    unset = bool(term.effect.nominal) and term.effect.described(robot, term.joint) == 0
    return 0.5 * thresholds.gain if term.effect.acceptance.common or unset else thresholds.gain


def rejection(before: Solution, after: Solution, thresholds: Thresholds) -> str | None:
    """Why the last term is not accepted; None where it is."""
    term = after.terms[-1]
    if term.effect.acceptance.inside_bounds and at_bound(term):
        return "its shape runs to the end of what is possible"
    if not term.effect.resolved(after.problem.states, term.joint, tuple(BARELY * x for x in term.shape)):
        return "is too small to be told from how the motion was sampled"
    if term.effect.acceptance.several_channels and not seen_by_several(before, after.block(term)[0]):
        return "only one channel asks for it"
    if after.problem.side == "supply" and _spread(after, term) < SMALLEST:
        return "is too small to be of use"
    chi2, left = before.problem.chi2(before.residual), after.problem.chi2(after.residual)
    at = slice(None) if term.joint is None else slice(term.joint, term.joint + 1)
    drop = float(np.sum((chi2 - left)[at]))
    if relieves_tension(before, after, thresholds):
        return None
    if drop < thresholds.least * float(np.min(chi2[at])):
        return "hardly lowers the residual"
    excess = float(np.sum(np.maximum(chi2[at] - 1.15, 0.0)))
    if drop < thresholds.share * excess:
        return f"explains only {100 * max(drop, 0) / excess:.0f} % of what is unexplained there"
    if not term.effect.form.intermittent and not lowers_held_out_error(before, after, thresholds):
        return "hardly lowers the error on data left out"
    return None


def _spread(solution: Solution, term: Term) -> float:
    """Standard deviation of what a term adds to the supply, in units of its noise; infinite for a constant."""
    added = solution.block(term)[0].times(solution.coefficients(term), 1)[:, 0]
    spread = float(np.std(added))
    return spread / float(solution.problem.floor[0]) if spread > 1e-9 * float(np.max(np.abs(added))) else np.inf


def collinear(before: Solution, after: Solution, factor: float) -> Term | None:
    """The term whose coefficients the last one of ``after`` makes ``factor`` times less certain; None where none is.

    The square of that ratio is the variance inflation factor; from about 10 on columns count as collinear.
    """
    old, new = (np.sqrt(np.diag(s.fit.covariance)) for s in (before, after))
    for place, term in zip(before.fit.slices, before.terms, strict=True):
        if float(np.max(new[place] / np.maximum(old[place], 1e-300))) > factor:
            return term
    return None


def physical(term: Term, coefficients: Float, robot: RobotDescription) -> bool:
    """True if the sign is possible, and the scale of an effect that is simulated to scale."""
    effect, first = term.effect, float(coefficients[0])
    if not effect.sensible(coefficients, robot, term.joint) or impossible(effect.name, coefficients) is not None:
        return False
    if effect.form.to_scale:
        return abs(first - 1) < OFF_SCALE
    if effect.nominal:
        return first + effect.described(robot, term.joint) > 0
    above = effect.acceptance.above
    return above is None or first > above


def within_prior(term: Term, coefficients: Float, prior: Prior) -> bool:
    """True if the coefficients are within what their prior calls possible."""
    off = np.abs(coefficients - prior.mean) / np.sqrt(np.diag(prior.covariance))
    return bool(np.all(off < term.effect.acceptance.prior_deviations))


def tension(solution: Solution) -> float:
    """Squared stretch of the nominal parameters in units of their tolerances, summed."""
    out = 0.0
    for block, place in zip(solution.problem.nuisance, solution.problem.design.slices, strict=True):
        off = solution.fit.coefficients[place] - block.prior.mean
        out += float(off @ np.linalg.solve(block.prior.covariance, off))
    return out


def lowers_held_out_error(before: Solution, after: Solution, thresholds: Thresholds) -> bool:
    """True if the last term lowers the error on data left out, as the fit weighs its samples and as they are.

    By a share of it; near the noise by less, too, where it does so block after block: the mean over blocks of what it
    saves is compared with its standard error (Diebold and Mariano 1995).
    """
    chi2 = before.problem.chi2(before.residual)
    block = after.block(after.terms[-1])[0]
    channels = [c for c in range(len(chi2)) if block.channel in (None, c)]
    root = before.problem.design.root
    held = CrossValidation(before.problem, before.factor)
    old, new = held.residual(before.terms), CrossValidation(after.problem, before.factor).residual(after.terms)
    saved = held.by_block(np.square(root * old) - np.square(root * new))
    steady = np.mean(saved, axis=0) > STEADY * np.std(saved, axis=0, ddof=1) / np.sqrt(len(saved))
    near = chi2 < thresholds.costly
    asked = thresholds.held_out * np.where(near, 2.0, 1 - 1 / np.maximum(chi2, 1.0))
    much = rms(root * new) < (1 - asked) * rms(root * old)
    enough = (much | (near & steady)) & (rms(new) < rms(old))
    return bool(np.any(enough[channels]))


def raises_held_out_error(before: Solution, after: Solution) -> bool:
    """True if the last term raises the error on data left out in each channel that it acts on."""
    channel = after.block(after.terms[-1])[0].channel
    old, new = (rms(CrossValidation(s.problem, before.factor).residual(s.terms)) for s in (before, after))
    worse = new > RISE * old
    return bool(np.all(worse) if channel is None else worse[channel])


def relieves_tension(before: Solution, after: Solution, thresholds: Thresholds) -> bool:
    """True if nominal parameters that were stretched beyond their tolerances come back."""
    return tension(before) - tension(after) > 2 * thresholds.gain


def seen_by_several(now: Solution, block: Block) -> bool:
    """True if more than one channel asks for a block that acts on all, and few for its contrary."""
    parts = [Block(block.columns[:, c], c, block.prior) for c in range(block.columns.shape[1])]
    gains = np.array([gain for gain, _ in now.fit.gains(parts)])
    agreed = float(np.sum(np.maximum(gains, 0.0)))
    return float(np.sum(gains) - np.max(gains)) > SEVERAL and _against(now, parts) < AGAINST * agreed


def _against(now: Solution, parts: Sequence[Block]) -> float:
    """nats that channels give for the contrary of a block that is simulated to scale; 0 for other blocks."""
    if parts[0].columns.shape[1] > 1 or np.any(parts[0].prior.mean == 0):
        return 0.0
    free = [Block(part.columns, part.channel, Prior.spread(np.ones(1))) for part in parts]
    return sum(gain for gain, own in now.fit.gains(free) if own[0] < 0 and gain > 0)
