"""An arm without a description: weights of gravity by its angles alone, and priors from the power of its cycles.

The potential energy of a serial arm is a sum of cosines and sines of sums and differences of its angles. Those of one,
two and three consecutive joints take the place of the links' parameters; inertia is constant and each joint's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.robot.regression import Prior

SUMS = ((1,), (1, 1), (1, -1), (1, 0, 1), (1, 1, 1))
"""Factors of the angles of a joint, the one before it and the one before that, in the arguments of its weights."""
GRAVITY, COULOMB, VISCOUS, ROTOR, COPPER = 0.4, 0.1, 0.1, 0.2, 0.05
"""Power of each cause in a joint at its highest speed and acceleration, as a share of the cycles' range of power: one
sigma of each weight of gravity; mean and one sigma of the others."""
LEVEL, LEAST_LEVEL = 0.2, 10.0
"""One sigma of the standing power, as a share of that range, and at least, W."""
GAIN, BACK = 0.06, 0.4
"""Deviation of the supply's gains from 1 while drives take and return power (one sigma)."""
EDGES = (0.02, 0.98)
"""Quantiles that are the lowest and the highest power, speed and acceleration."""
SLOWEST, SOFTEST, WEAKEST = 0.05, 0.1, 5.0
"""Smallest range of a joint's speed, rad/s, of its acceleration, rad/s², and of power, W."""


@dataclass(frozen=True)
class BareArm:
    """An arm of n ``joints`` of which only the ``levers`` (n,) are known; it stands for its own body."""

    levers: Float

    @property
    def body(self) -> BareArm:
        """The arm itself."""
        return self

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.levers)

    @cached_property
    def _arguments(self) -> Float:
        """Factors (5 n, n) of the angles in each argument; 0 for sums that begin before the first joint."""
        out = np.zeros((self.joints, len(SUMS), self.joints))
        for joint in range(self.joints):
            for number, factors in enumerate(SUMS):
                if len(factors) <= joint + 1:
                    out[joint, number, joint - np.arange(len(factors))] = factors
        return out.reshape(-1, self.joints)

    def regressor(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Torque (N, n, 10 n) Nm at ``q`` (N, n) of each weight of a cosine and a sine; not of inertia."""
        angle = (q / self.levers) @ self._arguments.T
        slopes = np.stack([-np.sin(angle), np.cos(angle)], axis=2)
        torque = slopes[:, None] * self._arguments.T[:, :, None]
        return np.asarray(torque.reshape(len(q), self.joints, -1) / self.levers[:, None])

    def prior(self, patterns: Sequence[Pattern]) -> Prior:
        """Prior of the packed parameters (k,), scaled by the power, speeds and accelerations of healthy cycles."""
        low, high = np.quantile(np.concatenate([pattern.power for pattern in patterns]), EDGES)
        watts = max(float(high - low), WEAKEST)
        speed, acceleration = (
            np.maximum(np.quantile(np.abs(np.concatenate(rates)), EDGES[1], axis=0), least) * self.levers
            for rates, least in zip(zip(*(p.rates for p in patterns), strict=True), (SLOWEST, SOFTEST), strict=True)
        )
        torque = watts / speed
        rotor, coulomb, viscous = ROTOR * torque / acceleration, COULOMB * torque, VISCOUS * torque / speed
        copper = COPPER * speed / torque
        mean = Parameters(np.zeros(10 * self.joints), rotor, coulomb, viscous, copper, float(low), 1.0, 1.0)
        supply = np.array([max(LEAST_LEVEL, LEVEL * watts), GAIN, BACK])
        own = [np.repeat(GRAVITY * torque, 10), rotor, coulomb, viscous, copper, supply]
        return Prior.spread(np.concatenate(own), mean.packed())
