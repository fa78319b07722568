"""Nominal parameters pass the same test as findings: those that data left out do not confirm keep the user's values."""

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
"""Factor on the tolerance of a parameter that keeps the user's value."""
WORTH = 0.005
"""Share of the mean square error on data left out, summed over the channels, that freeing a group must remove."""
WORSE = 1.01
"""Largest mean square error of the model on data left out at a joint, relative to the simulation's."""
LOOSER = (3.0, 10.0)
"""Factors on the tolerances of the links, or of all supply parameters, tried to reduce a large residual."""
BETTER, SURE = 0.1, 2.0
"""Share and standard errors by which the error of one joint must fall for looser tolerances to be accepted."""


def freed(problem: Problem, factors: Float) -> Problem:
    """The problem with the tolerance of each group of nominal parameters multiplied by its factor (B,)."""
    pairs = zip(problem.nuisance, factors.tolist(), strict=True)
    return problem.with_priors([_scaled(block.prior, factor) for block, factor in pairs])


def links_fixed(problem: Problem) -> Float:
    """Factors (B,) that leave only friction and rotors free."""
    return np.where(np.arange(len(problem.nuisance)) < problem.states[0].arm.body.joints, FIXED, 1.0)


def all_fixed(problem: Problem) -> Float:
    """Factors (B,) that fix all nominal parameters."""
    return np.full(len(problem.nuisance), FIXED)


def loose(problem: Problem, looseness: float) -> Problem:
    """The problem with the tolerances of the links, or of all supply parameters, multiplied by ``looseness``."""
    priors = [_scaled(block.prior, looseness) for block in problem.nuisance]
    if problem.side == "torque":
        robot, links = problem.states[0].robot, problem.states[0].arm.body.parameters().reshape(-1, PER_LINK)
        own = [link_prior(link, looseness * robot.tolerances.link) for link in links]
        priors = [*own, *(block.prior for block in problem.nuisance[len(links) :])]
    return problem.with_priors(priors)


def looseness(problem: Problem, terms: Sequence[Term], factor: Float) -> float:
    """Factor on tolerances (see ``loose``) that data left out support with the given terms; 1 if they support none."""
    best, error = 1.0, LeaveOut(problem, factor).errors(terms)
    for trial in LOOSER:
        new = LeaveOut(loose(problem, trial), factor).errors(terms)
        found = compared(error, new)
        if found.most > BETTER and found.sure > SURE:
            best, error = trial, new
    return best


def confirmed(problem: Problem, terms: Sequence[Term], factor: Float) -> Float:
    """Factors (B,), 1 for groups that data left out confirm as free: each link, and each joint's friction and rotor.

    Groups are tested in turn, the one whose freedom helps least first. If the error without its freedom is as low, its
    parameters keep the user's values.
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
    # Parameters that help one joint must not make another joint worse than the simulation.
    simulated = np.sum(LeaveOut(freed(problem, all_fixed(problem)), factor).errors([]), axis=0)
    for group in groups:
        if not np.any(worse := np.sum(error, axis=0) > WORSE * simulated):
            break
        trial, new = fixed(group)
        if np.sum(new[:, worse]) < np.sum(error[:, worse]):
            factors, error = trial, new
    return factors


def _groups(problem: Problem) -> list[list[int]]:
    """Indices of the blocks that are confirmed together."""
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
