"""Acceptance of a term: required evidence, error on data left out, and distinction from other terms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.explain.fit.coordinate_search import at_bound
from cellwatt_plugins.explain.fit.leave_out import Held, LeaveOut, compared, rms
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.thresholds import Thresholds
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.regression import Prior

SEVERAL = 3.0
"""Smallest summed evidence (nats) for an effect of the whole recording from all channels but the strongest one."""
BARELY = 0.97
"""Factor on a shape. A shape that is unresolved when reduced by this factor is at the limit of resolution."""
AGAINST = 0.3
"""Largest evidence of channels for the opposite of an effect of the whole recording, as a share of that for it."""
SMALLEST = 0.2
"""Smallest change of the power residual by a supply term, as a share of the supply's noise."""
RELIEVED = 0.25
"""Largest squared stretch that any group may retain to count as relieved, as a share of the largest one before."""
MOST = 0.8
"""Share of the error that an unusual term must remove if it adds less evidence than required."""
SOLVED = 0.9
"""Share of a large residual that a drive's limit or dead band must remove: a real one removes nearly all of it."""
ALL = 0.99
"""Share of the error above which a drive's limit or dead band is accepted even if it is reached only once."""
OF_FALL = 0.1
"""Largest rise of another channel's error by a term of the whole arm, as a share of the error that it removes."""
PEAK = 8.0
"""Smallest peak of an effect that is active in few folds only, in residuals (rms) of the channel."""
OFTEN = 3
"""Smallest number of folds in which a term must be active to be tested on data left out."""
ACTIVE = 0.1
"""Share of its maximum from which a term counts as active."""
OFF_SCALE = 0.35
"""Largest deviation from 1 of the coefficient of an effect that is simulated to scale."""


def required_gain(term: Term, robot: RobotDescription, thresholds: Thresholds) -> float:
    """Evidence (nats) that a term must add; half the threshold for common effects and parameters described as 0."""
    likely = term.effect.acceptance.common or unset(term, robot)
    return 0.5 * thresholds.gain if likely else thresholds.gain


def unset(term: Term, robot: RobotDescription) -> bool:
    """True for a plain parameter that the description gives as 0 though most arms have it."""
    return bool(term.effect.nominal) and term.effect.described(robot, term.joint) == 0


def rejection(before: Solution, after: Solution, thresholds: Thresholds, gain: float) -> str | None:
    """Reason why the last term, which adds ``gain`` nats, is rejected; None if it is accepted."""
    term = after.terms[-1]
    if term.effect.acceptance.inside_bounds and at_bound(term):
        return "has a shape at the limit of its range"
    if not term.effect.resolved(after.problem.states, term.joint, tuple(BARELY * x for x in term.shape)):
        return "is too small to distinguish from the sampling of the motion"
    if not sound(after, term):
        return "has a value or a shape that is not physical"
    if term.effect.acceptance.several_channels and not seen_by_several(before, after.block(term)[0]):
        return "is supported by one channel only"
    if after.problem.side == "supply":
        decrease = before.problem.chi2(before.residual) - after.problem.chi2(after.residual)
        if decrease[0] < SMALLEST**2:
            return None if relieves_tension(before, after, thresholds) else "is too small to matter"
    return unconfirmed(before, after, term, thresholds, gain)


def unconfirmed(before: Solution, after: Solution, term: Term, thresholds: Thresholds, gain: float) -> str | None:
    """Reason why data left out do not confirm a term that ``after`` has and ``before`` lacks; None if they do.

    A term with little evidence must remove a large share of the error on data left out: with much of an arm
    unexplained, every term adds some evidence. Effects active in few folds cannot be tested on data left out.
    """
    enough = gain >= required_gain(term, after.problem.states[0].robot, thresholds)
    # A drive's limit or dead band can absorb unknown physics as easily as the parameters of its law can.
    shaped = term.effect.acts_on == "drive" and term.effect.form.to_scale and term.joint is not None
    relieved = not shaped and relieves_tension(before, after, thresholds)
    if (enough and _seldom(after, term)) or relieved or gain > term.effect.acceptance.by_evidence:
        return None
    found = held(before, after, term)
    upon = any(t.joint == term.joint and term.effect.name in t.effect.relations.upon for t in after.terms)
    if enough and upon and found.share > -thresholds.rise:
        return None
    channels = channels_of(after, term)
    chi2, remaining = before.problem.chi2(before.residual)[channels], after.problem.chi2(after.residual)[channels]
    near = bool(np.min(chi2) < thresholds.near)
    if enough:
        share = 0.0 if near else thresholds.share
        share = SOLVED if shaped and np.min(remaining) > thresholds.much_left else share
        # A term that brings its channels to their noise is complete, however rarely it acts. Acting once is too rare,
        # unless a drive's limit, which frees no other number, removes nearly all of the error (``ALL``).
        solved = (float(np.max(remaining)) < thresholds.near and found.again) or (shaped and found.share > ALL)
        steady = solved or found.sure > (thresholds.sure if near else thresholds.steady)
        if found.share < share or not steady:
            return f"does not lower the mean square error on data left out enough: {100 * max(found.share, 0):.1f} %"
    elif found.share < (thresholds.much if term.effect.usual else MOST) or found.sure < thresholds.sure:
        return "adds too little evidence, and lowers the error on data left out too little"
    # A term of one joint raises the errors of others only through the links, which are refitted with it.
    if term.joint is None and found.rise > max(thresholds.rise, OF_FALL * found.share):
        return "raises the error of another channel on data left out"
    old, new = (rms(LeaveOut(s.problem, before.factor).residual(s.terms), s.problem.recorded) for s in (before, after))
    if gain < thresholds.clear and not np.any((new < old)[channels]):
        return "lowers no channel's rms error on data left out"
    return None


def _seldom(solution: Solution, term: Term) -> bool:
    """True if a term is intermittent and active in too few folds for data left out to test it."""
    if not term.effect.form.intermittent:
        return False
    acts = active(solution.block(term)[0].columns)
    return len(np.unique(LeaveOut(solution.problem, solution.factor).fold[acts])) < OFTEN


def active(columns: Float) -> Bool:
    """True (N,) where a term with ``columns`` (N, ...) is active."""
    size = np.abs(columns).reshape(len(columns), -1).max(axis=1)
    return np.asarray(size > ACTIVE * np.max(size))


def felt(before: Solution, after: Solution, term: Term, thresholds: Thresholds) -> bool:
    """False for an unusual term of ``after`` that removes little of the error at every joint.

    During the search such a term may make room for others; in the result it is of no use.
    """
    exempt = term.effect.usual or _seldom(after, term) or np.isfinite(term.effect.acceptance.by_evidence)
    if exempt or after.problem.side == "supply" or relieves_tension(before, after, thresholds):
        return True
    return held(before, after, term).most >= (thresholds.felt if term.joint is None else thresholds.share)


def stands_out(before: Solution, after: Solution, term: Term, thresholds: Thresholds) -> bool:
    """False if a term of ``after`` could equally represent the rest of its channels' residual beyond the noise.

    Effects simulated sample by sample are tried because a channel rings, and never explain it down to the noise.
    Effects simulated to scale cannot represent anything else.
    """
    channels = channels_of(after, term)
    remaining = float(np.min(after.problem.chi2(after.residual)[channels]))
    form = term.effect.form
    if term.effect.usual or form.sample_by_sample or form.to_scale or remaining < max(thresholds.near, 1.0):
        return True
    if _seldom(after, term):
        error = rms(after.residual, after.problem.recorded)
        return bool(np.any(np.max(np.abs(after.added(term)), axis=0)[channels] > PEAK * error[channels]))
    # Links stretched within their tolerances may hide a joint's missing effect: the effect must then relieve the links.
    if term.joint is not None and relieves_tension(before, after, thresholds):
        return True
    found = held(before, after, term)
    return found.sure > thresholds.certain or found.most * remaining > (1 - found.most) * (remaining - 1)


def held(before: Solution, after: Solution, term: Term) -> Held:
    """Change of the error on data left out by a term of ``after``, summed over the channels on which it acts."""
    old, new = (LeaveOut(s.problem, before.factor).errors(s.terms) for s in (before, after))
    return compared(old, new, channels_of(after, term))


def channels_of(solution: Solution, term: Term) -> list[int]:
    """The channels that show a term: that of its joint, or all channels for a term of the whole arm."""
    if solution.problem.side == "supply":
        return [0]
    return list(range(len(solution.problem.floor))) if term.joint is None else [term.joint]


def collinear(before: Solution, after: Solution, factor: float) -> Term | None:
    """The term whose coefficients the last one of ``after`` makes ``factor`` times less certain; None if none is.

    The square of that ratio is the variance inflation factor; columns count as collinear from about 10.
    """
    old, new = (np.sqrt(np.diag(s.fit.covariance)) for s in (before, after))
    for place, term in zip(before.fit.slices, before.terms, strict=True):
        if np.any(new[place] > factor * old[place]):
            return term
    return None


def physical(term: Term, coefficients: Float, robot: RobotDescription) -> bool:
    """True if sign and size are physically possible, and the scale of an effect that is simulated to scale is near
    1."""
    effect, first = term.effect, float(coefficients[0])
    if not effect.sensible(coefficients, term.shape, robot, term.joint):
        return False
    if effect.form.to_scale:
        return abs(first - 1) < OFF_SCALE
    if effect.nominal:
        return first + effect.described(robot, term.joint) > 0
    above = effect.acceptance.above
    return above is None or first > above


def sound(solution: Solution, term: Term) -> bool:
    """True if a fitted term is ``physical``, its shape is ``closed``, and what it lessens, if its first coefficient is
    negative, is there."""
    robot, coefficients = solution.problem.states[0].robot, solution.coefficients(term)
    lessened = term.effect.relations.lessens
    if not physical(term, coefficients, robot) or not term.effect.closed(term.shape):
        return False
    if not lessened or term.joint is None or coefficients[0] > 0:
        return True
    found = {t.effect.name for t in solution.terms if t.joint == term.joint}
    return any(name in found or robot.column(name)[term.joint] > 0 for name in lessened)


def within_prior(term: Term, coefficients: Float, prior: Prior) -> bool:
    """True if the coefficients are within the range that their prior allows."""
    off = np.abs(coefficients - prior.mean) / np.sqrt(np.diag(prior.covariance))
    return bool(np.all(off < term.effect.acceptance.prior_deviations))


def tension(solution: Solution) -> Float:
    """Squared stretch of each group of nominal parameters, in units of their tolerances."""
    out = []
    for block, place in zip(solution.problem.nuisance, solution.problem.design.slices, strict=True):
        off = solution.fit.coefficients[place] - block.prior.mean
        out.append(float(off @ np.linalg.solve(block.prior.covariance, off)))
    return np.array(out)


def relieves_tension(before: Solution, after: Solution, thresholds: Thresholds) -> bool:
    """True if all nominal parameters that were stretched beyond their tolerances return to them."""
    old, new = tension(before), tension(after)
    if not len(old) or float(np.sum(old) - np.sum(new)) < 2 * thresholds.gain:
        return False
    return bool(np.max(new) < max(thresholds.relaxed * PER_LINK, RELIEVED * float(np.max(old))))


def seen_by_several(now: Solution, block: Block) -> bool:
    """True if more than one channel supports a block that acts on all channels, and few support its opposite."""
    parts = [Block(block.columns[:, c], c, block.prior) for c in range(block.columns.shape[1])]
    gains = np.array([gain for gain, _ in now.fit.gains(parts)])
    agreed = float(np.sum(np.maximum(gains, 0.0)))
    return float(np.sum(gains) - np.max(gains)) > SEVERAL and _against(now, parts) < AGAINST * agreed


def _against(now: Solution, parts: Sequence[Block]) -> float:
    """Evidence (nats) of channels for the opposite sign of a block that is simulated to scale; 0 for other blocks."""
    if parts[0].columns.shape[1] > 1 or np.any(parts[0].prior.mean == 0):
        return 0.0
    free = [Block(part.columns, part.channel, Prior.spread(np.ones(1))) for part in parts]
    return sum(gain for gain, own in now.fit.gains(free) if own[0] < 0 and gain > 0)
