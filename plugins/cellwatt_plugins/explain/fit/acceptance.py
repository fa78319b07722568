"""Acceptance of a term: what it must add, show on data left out, and be told apart from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
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
"""nats that all channels but the one that asks most must give for what concerns the whole recording."""
BARELY = 0.97
"""A shape that would not be resolved were it so much smaller is at the end of what can be."""
AGAINST = 0.3
"""Share of their evidence that other channels may give for the contrary of what concerns the whole recording."""
SMALLEST = 0.2
"""Of the supply's noise by which a term must change what retuned numbers leave of its power."""
RELIEVED = 0.25
"""Share of the greatest stretch of any group that may be left where it comes back."""
MOST = 0.8
"""Share that what is no usual thing must take off where it adds less evidence than others."""
SOLVED = 0.9
"""Share that a drive's limit or dead band must take off where much is left: one that is there says all that it does."""
ALL = 0.99
"""Share that such a one takes off where it is reached but once, and nothing else is there."""
OF_FALL = 0.1
"""Share of what a term of the whole arm takes off in all by which another channel's error may rise."""
PEAK = 8.0
"""Times what is left at a channel that something must reach there that is there at one time only."""
OFTEN = 3
"""Folds in which a term must be there for data left out to tell of it."""
THERE = 0.1
"""Share of its greatest from which a term is there."""
OFF_SCALE = 0.35
"""Largest distance from 1 of the coefficient of an effect that is simulated to scale."""


def required_gain(term: Term, robot: RobotDescription, thresholds: Thresholds) -> float:
    """nats that a term must add; half of it for no rare thing."""
    likely = term.effect.acceptance.common or unset(term, robot)
    return 0.5 * thresholds.gain if likely else thresholds.gain


def unset(term: Term, robot: RobotDescription) -> bool:
    """True of a plain parameter that is described as 0: most arms have it."""
    return bool(term.effect.nominal) and term.effect.described(robot, term.joint) == 0


def rejection(before: Solution, after: Solution, thresholds: Thresholds, gain: float) -> str | None:
    """Why the last term, which adds ``gain`` nats, is not accepted; None where it is."""
    term = after.terms[-1]
    if term.effect.acceptance.inside_bounds and at_bound(term):
        return "its shape runs to the end of what is possible"
    if not term.effect.resolved(after.problem.states, term.joint, tuple(BARELY * x for x in term.shape)):
        return "is too small to be told from how the motion was sampled"
    if term.effect.acceptance.several_channels and not seen_by_several(before, after.block(term)[0]):
        return "only one channel asks for it"
    if after.problem.side == "supply" and _taken(before, after) < SMALLEST**2:
        return None if relieves_tension(before, after, thresholds) else "is too small to be of use"
    return unconfirmed(before, after, term, thresholds, gain)


def unconfirmed(before: Solution, after: Solution, term: Term, thresholds: Thresholds, gain: float) -> str | None:
    """Why data left out do not confirm a term of ``after`` that ``before`` is without; None where they do.

    What adds little evidence, as everything does in an arm of which much is unexplained, must lower the error there by
    much. Of what is there at one time only, no data can be left out.
    """
    enough = gain >= required_gain(term, after.problem.states[0].robot, thresholds)
    # A drive's limit or dead band can take up what no name says as well as the numbers of its law can.
    shaped = term.effect.acts_on == "drive" and term.effect.form.to_scale and term.joint is not None
    relieved = not shaped and relieves_tension(before, after, thresholds)
    if (enough and _seldom(after, term)) or relieved or gain > term.effect.acceptance.by_evidence:
        return None
    found = held(before, after, term)
    upon = any(t.joint == term.joint and term.effect.name in t.effect.relations.upon for t in after.terms)
    if enough and upon and found.share > -thresholds.rise:
        return None
    channels = channels_of(after, term)
    chi2, left = before.problem.chi2(before.residual)[channels], after.problem.chi2(after.residual)[channels]
    near = bool(np.min(chi2) < thresholds.near)
    if enough:
        share = 0.0 if near else thresholds.share
        share = SOLVED if shaped and np.min(left) > thresholds.much_left else share
        # What brings a channel to its noise is all that was there, however seldom it acts; once is too seldom, unless
        # nothing else was there and no number but the limit was free.
        solved = (float(np.max(left)) < thresholds.near and found.again) or (shaped and found.share > ALL)
        steady = solved or found.sure > (thresholds.sure if near else thresholds.steady)
        if found.share < share or not steady:
            return f"takes {100 * max(found.share, 0.0):.1f} % off the mean square error on data left out"
    elif found.share < (thresholds.much if term.effect.usual else MOST) or found.sure < thresholds.sure:
        return "adds too little evidence, and does not lower the error on data left out by much"
    # What acts at one joint raises the others' errors only by the links, which are fitted anew beside it.
    if term.joint is None and found.rise > max(thresholds.rise, OF_FALL * found.share):
        return "raises the error of another channel on data left out"
    old, new = (rms(LeaveOut(s.problem, before.factor).residual(s.terms, channels)) for s in (before, after))
    if not np.any(new < old):
        return "lowers no error on data left out, sample by sample"
    return None


def _seldom(solution: Solution, term: Term) -> bool:
    """True if a term is there at some times only, in so few folds that none can be left out."""
    if not term.effect.form.intermittent:
        return False
    columns = solution.block(term)[0].columns
    size = np.abs(columns).reshape(len(columns), -1).max(axis=1)
    there = size > THERE * np.max(size)
    return len(np.unique(LeaveOut(solution.problem, solution.factor).fold[there])) < OFTEN


def felt(before: Solution, after: Solution, term: Term, thresholds: Thresholds) -> bool:
    """False for a term of ``after`` that is no usual thing, where it takes little off the error of every joint.

    On the way to what is there such a term may make room for others; at the end nobody has use for it.
    """
    exempt = term.effect.usual or _seldom(after, term) or np.isfinite(term.effect.acceptance.by_evidence)
    if exempt or after.problem.side == "supply" or relieves_tension(before, after, thresholds):
        return True
    return held(before, after, term).most >= (thresholds.felt if term.joint is None else thresholds.share)


def stands_out(before: Solution, after: Solution, term: Term, thresholds: Thresholds) -> bool:
    """False if a term of ``after`` could as well stand for what else is left at its channels beyond the noise.

    What rings was asked for because that rings, and is never followed to the noise. What is simulated to scale can
    stand for nothing else.
    """
    channels = channels_of(after, term)
    left = float(np.min(after.problem.chi2(after.residual)[channels]))
    form = term.effect.form
    if term.effect.usual or form.sample_by_sample or form.to_scale or left < max(thresholds.near, 1.0):
        return True
    if _seldom(after, term):
        return bool(np.any(np.max(np.abs(after.added(term)), axis=0)[channels] > PEAK * rms(after.residual)[channels]))
    # What a joint lacks may hide in links that are stretched for it: those are what it must take off, then.
    if term.joint is not None and relieves_tension(before, after, thresholds):
        return True
    found = held(before, after, term)
    return found.sure > thresholds.certain or found.most * left > (1 - found.most) * (left - 1)


def held(before: Solution, after: Solution, term: Term) -> Held:
    """What a term of ``after`` does to the error on data left out, summed over the channels that it acts on."""
    old, new = (LeaveOut(s.problem, before.factor).errors(s.terms) for s in (before, after))
    return compared(old, new, channels_of(after, term))


def channels_of(solution: Solution, term: Term) -> list[int]:
    """The channels that tell of a term: its joint's, or all of them where it is of the whole arm."""
    if solution.problem.side == "supply":
        return [0]
    return list(range(len(solution.problem.floor))) if term.joint is None else [term.joint]


def _taken(before: Solution, after: Solution) -> float:
    """What the supply's mean square residual falls by, in units of its noise."""
    return float((before.problem.chi2(before.residual) - after.problem.chi2(after.residual))[0])


def collinear(before: Solution, after: Solution, factor: float) -> Term | None:
    """The term whose coefficients the last one of ``after`` makes ``factor`` times less certain; None where none is.

    The square of that ratio is the variance inflation factor; from about 10 on columns count as collinear.
    """
    old, new = (np.sqrt(np.diag(s.fit.covariance)) for s in (before, after))
    for place, term in zip(before.fit.slices, before.terms, strict=True):
        if np.any(new[place] > factor * old[place]):
            return term
    return None


def physical(term: Term, coefficients: Float, robot: RobotDescription) -> bool:
    """True if the sign is possible, and the scale of an effect that is simulated to scale."""
    effect, first = term.effect, float(coefficients[0])
    if not effect.sensible(coefficients, term.shape, robot, term.joint):
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


def tension(solution: Solution) -> Float:
    """Squared stretch of each group of nominal parameters, in units of their tolerances."""
    out = []
    for block, place in zip(solution.problem.nuisance, solution.problem.design.slices, strict=True):
        off = solution.fit.coefficients[place] - block.prior.mean
        out.append(float(off @ np.linalg.solve(block.prior.covariance, off)))
    return np.array(out)


def relieves_tension(before: Solution, after: Solution, thresholds: Thresholds) -> bool:
    """True if nominal parameters that were stretched beyond their tolerances come back, all of them."""
    old, new = tension(before), tension(after)
    if not len(old) or float(np.sum(old) - np.sum(new)) < 2 * thresholds.gain:
        return False
    return bool(np.max(new) < max(thresholds.relaxed * PER_LINK, RELIEVED * float(np.max(old))))


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
