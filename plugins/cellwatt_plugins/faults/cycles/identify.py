"""Fits the parameters of an arm to the power of its healthy cycles, with its description, if any, as the prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Mechanics, Motion, Parameters, heft, nominal
from cellwatt_plugins.faults.cycles.bare_arm import BACK, GAIN, BareArm
from cellwatt_plugins.faults.cycles.load import load_of
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.meter.model import Meter, Windows
from cellwatt_plugins.robot.priors import body_prior, links_prior
from cellwatt_plugins.robot.regression import Fit, Prior, Products, gauss_newton

ROUNDS = 8
LEAST = 0.05
"""Smallest value of a positive parameter, as a share of the description's value."""
MISFIT = 1.0
SHARE = 0.03
"""Model error that no parameter explains, W, and as a share of the power above standing power (one sigma) …"""
ALIKE = 0.2
"""… and the time over which it is correlated, s."""
LOAD = 0.5
"""Mass that the last link may carry in addition to the description, kg …"""
REACH = 0.1
"""… and its largest distance from the link's frame, m, of an arm of ``USUAL_MASS``."""


@dataclass(frozen=True)
class FittedArm:
    """An arm's links with the parameters fitted to healthy power, and their covariance (k, k)."""

    body: Mechanics
    parameters: Parameters
    covariance: Float

    @property
    def bare(self) -> bool:
        """True if the arm has no description."""
        return isinstance(self.body, BareArm)

    @cached_property
    def deviations(self) -> Float:
        """Cholesky factor (k, k) of the covariance: each column is one sigma."""
        return np.asarray(np.linalg.cholesky(self.covariance))


def identify(arm: Arm | BareArm, patterns: Sequence[Pattern], meter: Meter | None) -> FittedArm:
    """Fit an arm to the power of its healthy cycles, within the tolerances of its description (``robot.yaml``), if any.

    ``meter`` is the slow meter that measured the power; None if it was sampled.
    """
    prior = _prior(arm, patterns)
    # Inertia, friction and resistance must stay positive; link moments may be negative.
    least = np.where(prior.mean > 0, LEAST * prior.mean, -np.inf)
    equations = _Equations(arm.body, patterns, meter)
    values, _ = gauss_newton(equations, prior, prior.mean, ROUNDS, within=lambda fit: fit.bounded(least))
    return with_covariance(arm, Parameters.unpacked(values, arm.joints), patterns, meter)


def with_covariance(
    arm: Arm | BareArm, parameters: Parameters, patterns: Sequence[Pattern], meter: Meter | None
) -> FittedArm:
    """Return an arm with known parameters, and their covariance from these patterns."""
    equations = _Equations(arm.body, patterns, meter)(parameters.packed())
    return FittedArm(arm.body, parameters, Fit(equations, _prior(arm, patterns)).covariance)


class _Equations:
    """Equations of the patterns' power, linearised at given parameters (k,)."""

    def __init__(self, body: Mechanics, patterns: Sequence[Pattern], meter: Meter | None) -> None:
        self.body, self.patterns, self.meter = body, patterns, meter
        self.motions = [Motion.of(body, p.position, *p.rates) for p in patterns]
        self.variance = np.concatenate([_variance(p) for p in patterns])
        self.thin = np.concatenate([np.full(len(p.power), max(1.0, ALIKE / p.step)) for p in patterns])
        self.measured = np.concatenate([self._seen(p, p.power) for p in patterns])

    def __call__(self, values: Float) -> Products:
        now = Parameters.unpacked(values, self.body.joints)
        loads = [load_of(self.body, now, motion) for motion in self.motions]
        pairs = list(zip(self.patterns, loads, strict=True))
        slope = np.concatenate([self._seen(p, load.slope(now)) for p, load in pairs])
        misfit = self.measured - np.concatenate([self._seen(p, load.power) for p, load in pairs])
        # Power that the model cannot explain (a part gripped during the task) lowers the weight of the equations.
        more = max(1.0, float(np.mean(misfit**2 / self.variance)))
        return Products.of(slope, misfit + slope @ values, self.variance * self.thin * more)

    def _seen(self, pattern: Pattern, samples: Float) -> Float:
        """Samples (T,) or (T, k) of a pattern, averaged as by the meter from which the pattern was learnt."""
        if self.meter is None or not self.meter.window:
            return samples
        half = self.meter.window / 2
        return Windows(pattern.time - half, pattern.time + half).means(pattern.time, samples)


def _variance(pattern: Pattern) -> Float:
    """Variance (T,) W² of each sample about the model."""
    noise = float(np.median(pattern.spread)) ** 2 / pattern.cycles
    above = pattern.power - np.median(pattern.power)
    return np.asarray(noise + MISFIT**2 + (SHARE * above) ** 2)


def _prior(arm: Arm | BareArm, patterns: Sequence[Pattern]) -> Prior:
    """Return the prior of the packed parameters (k,): the description within its tolerances, if there is one."""
    if isinstance(arm, BareArm):
        return arm.prior(patterns)
    start, t = nominal(arm), arm.description.tolerances
    more = heft(start.link)
    links = links_prior(start.link, t.link).covariance
    links[-PER_LINK:, -PER_LINK:] += body_prior(LOAD * more, REACH * np.cbrt(more)).covariance
    own = [
        t.rotor_inertia * start.rotor,
        t.friction * start.coulomb,
        t.friction * start.viscous,
        t.supply * start.copper,
        np.array([t.supply * max(start.standby, 10.0), GAIN, BACK]),
    ]
    rest = Prior.spread(np.maximum(np.concatenate(own), 1e-9))
    return Prior(start.packed(), block_diag(links, rest.covariance))
