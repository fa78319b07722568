"""Parameters of an arm from the power of its healthy cycles, held by what its description says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Motion, Parameters, nominal
from cellwatt_plugins.faults.cycles.load import load_of
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.robot import Arm, Body
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.meter.model import Windows
from cellwatt_plugins.robot.priors import body_prior, links_prior
from cellwatt_plugins.robot.regression import Fit, Prior, Products, gauss_newton

ROUNDS = 8
LEAST = 0.05
"""Share of the description's value above which a positive parameter stays."""
MISFIT = 1.0
SHARE = 0.03
"""W, and share of the power above standing, that no parameter explains …"""
ALIKE = 0.2
"""… and that stays alike for so long, s."""
GAIN, BACK = 0.06, 0.4
"""Distance of the supply's gains from 1 while drives take and give power."""
LOAD = 0.5
"""kg: what the last link may carry beside what the description says …"""
REACH = 0.1
"""… and m from its frame within which that is."""


@dataclass(frozen=True)
class FittedArm:
    """A robot's rigid body with parameters as its healthy power has them, and their covariance (k, k)."""

    body: Body
    parameters: Parameters
    covariance: Float

    @cached_property
    def deviations(self) -> Float:
        """(k, k) with the covariance as its product with its transpose: one sigma in each column."""
        return np.asarray(np.linalg.cholesky(self.covariance))


def identify(arm: Arm, patterns: Sequence[Pattern]) -> FittedArm:
    """Fit an arm to the power of its healthy cycles, within the tolerances of its description (``robot.yaml``)."""
    prior = _prior(arm)

    def possible(values: Float) -> Float:
        # No inertia, friction or resistance turns negative; link moments may.
        return np.where((values < 0) & (prior.mean > 0), LEAST * prior.mean, values)

    values, _ = gauss_newton(_Equations(arm.body, patterns), prior, prior.mean, ROUNDS, within=possible)
    return with_covariance(arm, Parameters.unpacked(values, arm.joints), patterns)


def with_covariance(arm: Arm, parameters: Parameters, patterns: Sequence[Pattern]) -> FittedArm:
    """Return an arm of known parameters, with how well these patterns determine them."""
    equations = _Equations(arm.body, patterns)(parameters.packed())
    return FittedArm(arm.body, parameters, Fit(equations, _prior(arm)).covariance)


class _Equations:
    """The patterns' power as equations that are linear about given parameters (k,)."""

    def __init__(self, body: Body, patterns: Sequence[Pattern]) -> None:
        self.body, self.patterns = body, patterns
        self.motions = [Motion(p.position, *p.rates) for p in patterns]
        self.variance = np.concatenate([_variance(p) for p in patterns])
        self.thin = np.concatenate([np.full(len(p.power), max(1.0, ALIKE / p.step)) for p in patterns])
        self.measured = np.concatenate([_seen(p, p.power) for p in patterns])

    def __call__(self, values: Float) -> Products:
        now = Parameters.unpacked(values, self.body.joints)
        loads = [load_of(self.body, now, motion) for motion in self.motions]
        pairs = list(zip(self.patterns, loads, strict=True))
        slope = np.concatenate([_seen(p, load.slope(now)) for p, load in pairs])
        misfit = self.measured - np.concatenate([_seen(p, load.power) for p, load in pairs])
        # Where the patterns hold more than the model knows (a part that is gripped on the way), they count for less.
        more = max(1.0, float(np.mean(misfit**2 / self.variance)))
        return Products.of(slope, misfit + slope @ values, self.variance * self.thin * more)


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


def _prior(arm: Arm) -> Prior:
    """Return the prior of the packed parameters (k,): as described, within the tolerances."""
    start, t = nominal(arm), arm.description.tolerances
    links = links_prior(start.link, t.link).covariance
    links[-PER_LINK:, -PER_LINK:] += body_prior(LOAD, REACH).covariance
    own = [
        t.rotor_inertia * start.rotor,
        t.friction * start.coulomb,
        t.friction * start.viscous,
        t.supply * start.copper,
        np.array([t.supply * max(start.standby, 10.0), GAIN, BACK]),
    ]
    rest = Prior.spread(np.maximum(np.concatenate(own), 1e-9))
    return Prior(start.packed(), block_diag(links, rest.covariance))
