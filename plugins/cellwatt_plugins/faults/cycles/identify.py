"""Fits an arm's parameters to the power of its healthy cycles, held by what its description says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.arm import Motion, Parameters, nominal
from cellwatt_plugins.faults.cycles.load import load_of
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.robot import RigidBody, RobotDescription
from cellwatt_plugins.robot.meter import Windows

Float = NDArray[np.float64]

ROUNDS = 8
LEAST = 0.05
"""What should be positive stays above this share of the description's value."""
MISFIT = 1.0
SHARE = 0.03
"""W, and share of the power above standing, that no parameter explains …"""
ALIKE = 0.2
"""… and that stays alike for so long, s."""
LENGTH = 0.1
"""m: how far the centre of a link may lie from where the description has it is its share of this."""
GAIN, BACK = 0.06, 0.4
"""How far the supply's gains may be from 1 while drives take and give power."""
LOAD = 0.5
"""kg: what the last link may carry beside what the description says."""


@dataclass(frozen=True)
class Arm:
    """A robot's rigid body with parameters as its healthy power has them, and their covariance (k, k)."""

    body: RigidBody
    parameters: Parameters
    covariance: Float

    @cached_property
    def deviations(self) -> Float:
        """(k, k) with the covariance as its product with its transpose: one sigma in each column."""
        return np.asarray(np.linalg.cholesky(self.covariance))


def identify(robot: RobotDescription, body: RigidBody, patterns: Sequence[Pattern]) -> Arm:
    """Gauss–Newton with Gaussian priors from the description's tolerances (``robot.yaml``)."""
    start = nominal(robot, body)
    problem = _Problem(body, patterns, _tolerances(robot, start))
    prior = start.packed()
    values = prior.copy()
    for _ in range(ROUNDS):
        normal, pull = problem.normal(values)
        pull = pull - (values - prior) / problem.width
        values = values + problem.width * np.linalg.solve(normal, pull)
        # No inertia, friction or resistance turns negative; link moments may.
        values = np.where((values < 0) & (prior > 0), LEAST * prior, values)
    return with_covariance(robot, body, Parameters.unpacked(values, body.joints), patterns)


def with_covariance(
    robot: RobotDescription, body: RigidBody, parameters: Parameters, patterns: Sequence[Pattern]
) -> Arm:
    """An arm of known parameters, with how well these patterns determine them."""
    width = _tolerances(robot, nominal(robot, body))
    normal, _ = _Problem(body, patterns, width).normal(parameters.packed())
    return Arm(body, parameters, np.linalg.inv(normal) * width[:, None] * width)


class _Problem:
    """The patterns as equations in parameters scaled by ``width`` (k,), one standard deviation each."""

    def __init__(self, body: RigidBody, patterns: Sequence[Pattern], width: Float) -> None:
        self.body, self.width, self.patterns = body, width, patterns
        self.motions = [Motion(p.position, *p.rates) for p in patterns]
        self.variance = np.concatenate([_variance(p) for p in patterns])
        thin = [np.full(len(p.power), min(1.0, p.step / ALIKE)) for p in patterns]
        self.weight = np.concatenate(thin) / self.variance
        self.measured = np.concatenate([_seen(p, p.power) for p in patterns])

    def normal(self, values: Float) -> tuple[Float, Float]:
        """Normal matrix (k, k) with the prior's, and the pull (k,) of the measurement."""
        now = Parameters.unpacked(values, self.body.joints)
        loads = [load_of(self.body, now, motion) for motion in self.motions]
        pairs = list(zip(self.patterns, loads, strict=True))
        slope = np.concatenate([_seen(p, load.slope(now)) for p, load in pairs]) * self.width
        misfit = self.measured - np.concatenate([_seen(p, load.power) for p, load in pairs])
        # Where the patterns hold more than the model knows (a part that is gripped on the way), they count for less.
        weight = self.weight / max(1.0, float(np.mean(misfit**2 / self.variance)))
        normal = (slope * weight[:, None]).T @ slope + np.eye(len(values))
        return normal, slope.T @ (weight * misfit)


def _seen(pattern: Pattern, samples: Float) -> Float:
    """Samples (T,) or (T, k) of a pattern as the meter that it was learnt from shows them."""
    if not pattern.window:
        return samples
    half = pattern.window / 2
    return Windows(pattern.time - half, pattern.time + half).means(pattern.time, samples)


def _variance(pattern: Pattern) -> Float:
    """W² (T,) by which the model may miss each sample."""
    noise = float(np.median(pattern.spread)) ** 2 / pattern.cycles
    above = pattern.power - np.median(pattern.power)
    return np.asarray(noise + MISFIT**2 + (SHARE * above) ** 2)


def _tolerances(robot: RobotDescription, start: Parameters) -> Float:
    """One standard deviation (k,) of each packed parameter."""
    t = robot.tolerances
    link = start.link.reshape(-1, 10)
    mass = link[:, :1]
    spread = np.concatenate(
        [
            t.link * mass,
            1.5 * t.link * (np.abs(link[:, 1:4]) + LENGTH * mass),
            0.1 * (np.abs(link[:, 4:]) + 0.01 * mass),
        ],
        axis=1,
    )
    spread[-1] += LOAD * np.array([1.0, *[LENGTH] * 3, *[LENGTH**2] * 6])
    parts = [
        spread.ravel(),
        2 * t.rotor_inertia * start.rotor,
        2 * t.friction * start.coulomb,
        2 * t.friction * start.viscous,
        3 * t.supply * start.copper,
        np.array([t.supply * max(start.standby, 10.0) * 3, GAIN, BACK]),
    ]
    return np.asarray(np.maximum(np.concatenate(parts), 1e-9))
