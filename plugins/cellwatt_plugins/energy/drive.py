"""Fitted drives of an arm: power of the motors on the DC bus (``robot.drive``), and its share seen by the analyzer.

The supply cannot take back negative bus power: the electronics use the share ``returned`` of it, which lowers the power
that the analyzer measures, and the chopper burns the rest. The paper's estimate of E_RB by negative mechanical power
(eq. 11) ignores the losses of the motors.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.drive import TERMS, Drives, drawn

KINDS = len(TERMS)
"""Number of features per joint."""
MOTOR = ("torque_constant", "winding_resistance")
"""Keys of each joint that the electrical losses require."""
STILL = 5e-3
"""Speed below which a joint is at rest, rad/s, so that noise does not count as hysteresis."""


@dataclass(frozen=True)
class Drive:
    """Parameters of an arm's drives and supply; (n,) if each joint has its own.

    ``fixed`` W is the power at rest with brakes released and no torque: electronics and brakes. ``torque`` is a factor
    on the reported torque; ``copper`` is the winding resistance relative to the description, for the described torque
    constant and the reported torque; ``switching`` W/A, ``eddy`` W s²/rad² (eddy currents) and ``hysteresis`` W s/rad
    at the joint side. ``returned`` is the share of the braking power on the bus that the electronics use, 0 … 1.
    """

    fixed: float
    torque: Float
    copper: Float
    switching: Float
    eddy: Float
    hysteresis: Float
    returned: float

    def weights(self) -> Float:
        """Weights (5 n,) of the features in the power on the bus."""
        return np.concatenate([self.torque, self.copper, self.switching, self.eddy, self.hysteresis])


def effort(names: Collection[str], arm: Arm) -> tuple[str, Float]:
    """Quantity among the channels ``names`` of an arm that gives torques, and its factor (n,) to Nm.

    Without torque channels, torque is current times ``torque_constant``.
    """
    if "joint_1.torque" in names or "joint_1.current" not in names:
        return "torque", np.ones(arm.joints)
    return "current", arm.column("torque_constant")


def features(arm: Arm, torque: Float, velocity: Float) -> Float:
    """(N, 5 n): τ_i θ̇_i (W), R_i I_i² (W), |I_i| (A), θ̇_i² (rad²/s²), |θ̇_i| (rad/s).

    Computed from the reported torque (N, n) Nm and velocity (N, n) rad/s.
    """
    current = torque / arm.column("torque_constant")
    state = Drives.of(torque, velocity, current, arm.column("winding_resistance"))
    turning = replace(state, qd=np.where(np.abs(velocity) > STILL, velocity, 0.0))
    return np.hstack([term(turning) for term in TERMS.values()])


def bus_power(drive: Drive, feature: Float) -> Float:
    """Power (N,) W of all joints on the bus; negative while the motors return power."""
    return np.asarray(feature @ drive.weights())


def supply_power(drive: Drive, bus: Float) -> Float:
    """Power (N,) W measured by the analyzer for bus power ``bus`` (N,) W."""
    return np.asarray(drive.fixed + drawn(bus, 1.0, drive.returned))


def chopper_power(drive: Drive, bus: Float) -> Float:
    """Power (N,) W burnt by the chopper for bus power ``bus`` (N,) W."""
    return (1.0 - drive.returned) * np.maximum(-bus, 0.0)
