"""Nominal numbers pass the same test as findings: those that data left out do not confirm stay the user's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.leave_out import LeaveOut, compared
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.priors import link_prior
from cellwatt_plugins.robot.regression import Prior

FIXED = 1e-4
"""Factor on the tolerance of a number that stays the user's."""
WORTH = 0.005
"""Share of the mean square error on data left out, summed over the channels, that freeing a group must take off."""
WORSE = 1.01
"""Times the simulation's mean square error on data left out that the model's may be at a joint."""
LOOSER = (3.0, 10.0)
"""Factors on the tolerances of the links, or of all that the supply draws, that are tried where much is left."""
BETTER, SURE = 0.1, 2.0
"""Share and standard errors by which one joint's error must fall for numbers to be as far off as that."""


def freed(problem: Problem, factors: Float) -> Problem:
    """The problem with the tolerance of each group of nominal parameters times its factor (B,)."""
    pairs = zip(problem.nuisance, factors.tolist(), strict=True)
    return problem.with_priors([_scaled(block.prior, factor) for block, factor in pairs])


def links_fixed(problem: Problem) -> Float:
    """Factors (B,) that leave friction and rotors alone their freedom."""
    return np.where(np.arange(len(problem.nuisance)) < problem.states[0].arm.body.joints, FIXED, 1.0)


def all_fixed(problem: Problem) -> Float:
    """Factors (B,) that leave no nominal parameter its freedom."""
    return np.full(len(problem.nuisance), FIXED)


def loose(problem: Problem, looseness: float) -> Problem:
    """The problem with the tolerances of the links, or of all that the supply draws, times ``looseness``."""
    priors = [_scaled(block.prior, looseness) for block in problem.nuisance]
    if problem.side == "torque":
        robot, links = problem.states[0].robot, problem.states[0].arm.body.parameters().reshape(-1, PER_LINK)
        own = [link_prior(link, looseness * robot.tolerances.link) for link in links]
        priors = [*own, *(block.prior for block in problem.nuisance[len(links) :])]
    return problem.with_priors(priors)


def looseness(problem: Problem, terms: Sequence[Term], factor: Float) -> float:
    """Factor on tolerances (see ``loose``) that data left out ask for beside some terms; 1 where they ask for none."""
    best, error = 1.0, LeaveOut(problem, factor).errors(terms)
    for trial in LOOSER:
        new = LeaveOut(loose(problem, trial), factor).errors(terms)
        found = compared(error, new)
        if found.most > BETTER and found.sure > SURE:
            best, error = trial, new
    return best


def confirmed(problem: Problem, terms: Sequence[Term], factor: Float) -> Float:
    """Factors (B,), 1 for what data left out confirm to be free: each link, and each joint's friction and rotor.

    The groups are asked in turn, the one first whose freedom helps least: where the error without it is as low, its
    numbers stay as they are.
    """
    groups = _groups(problem)
    factors = np.ones(len(problem.nuisance))
    error = LeaveOut(problem, factor).errors(terms)

    def fixed(group: Sequence[int]) -> tuple[Float, Float]:
        trial = factors.copy()
        trial[list(group)] = FIXED
        return trial, LeaveOut(freed(problem, trial), factor).errors(terms)

    for group in sorted(groups, key=lambda g: compared(fixed(g)[1], error).share):
        trial, new = fixed(group)
        if compared(new, error).share < WORTH:
            factors, error = trial, new
    # Numbers that help one joint must not leave another worse than the simulation was.
    simulated = np.sum(LeaveOut(freed(problem, all_fixed(problem)), factor).errors([]), axis=0)
    for group in groups:
        if not np.any(worse := np.sum(error, axis=0) > WORSE * simulated):
            break
        trial, new = fixed(group)
        if np.sum(new[:, worse]) < np.sum(error[:, worse]):
            factors, error = trial, new
    return factors


def _groups(problem: Problem) -> list[list[int]]:
    """Places of the blocks that are confirmed together."""
    of_joint: dict[int | None, list[int]] = {}
    groups = []
    for i, block in enumerate(problem.nuisance):
        if block.channel is None or problem.side == "supply":
            groups.append([i])
        else:
            of_joint.setdefault(block.channel, []).append(i)
    return [*groups, *of_joint.values()]


def _scaled(prior: Prior, factor: float) -> Prior:
    return prior if factor == 1.0 else Prior(prior.mean, prior.covariance * factor**2)
