"""Fitted drives of an arm: what the motors draw from the DC bus (``robot.drive``), and what the analyzer sees of it.

Where the bus power is negative the supply cannot take it back: the electronics use the share ``returned`` of it,
which the analyzer misses in its reading, and the chopper burns the rest. The paper's estimate of E_RB by negative
mechanical power (eq. 11) leaves out what the motors themselves lose.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.recordings import RobotTrace
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.drive import TERMS, Drives, drawn

KINDS = len(TERMS)
"""Features of a joint."""
MOTOR = ("torque_constant", "winding_resistance")
"""Keys of each joint without which nothing can be said of electrical losses."""
STILL = 5e-3
"""rad/s: a slower joint stands, and its noise is not hysteresis."""


@dataclass(frozen=True)
class Drive:
    """Parameters of an arm's supply; (n,) each where a joint has its own.

    ``fixed`` W is the power at rest with brakes released and no torque: electronics and brakes. ``torque`` is a factor
    on the robot's torque, ``copper`` the winding resistance as a multiple of the described one, at the described torque
    constant and given torque; ``switching`` W/A, ``eddy`` W s²/rad² (currents) and ``hysteresis`` W s/rad at the joint
    side. ``returned`` is the share of the braking power on the bus that the electronics use, 0 … 1.
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
    """Quantity that tells torques among the channels ``names`` of an arm, and Nm (n,) of one of its unit.

    Where the arm gives no torques, its currents times ``torque_constant`` are.
    """
    if "joint_1.torque" in names or "joint_1.current" not in names:
        return "torque", np.ones(arm.joints)
    return "current", arm.column("torque_constant")


def features(arm: Arm, torque: Float, velocity: Float) -> Float:
    """(N, 5 n): τ_i θ̇_i (W), R_i I_i² (W), |I_i| (A), θ̇_i² (rad²/s²), |θ̇_i| (rad/s).

    Of torque (N, n) Nm as given and velocity (N, n) rad/s.
    """
    current = torque / arm.column("torque_constant")
    state = Drives.of(torque, velocity, current, arm.column("winding_resistance"))
    turning = replace(state, qd=np.where(np.abs(velocity) > STILL, velocity, 0.0))
    return np.hstack([term(turning) for term in TERMS.values()])


def motion_features(arm: Arm, motion: RobotTrace) -> Float:
    """``features`` of a recorded motion, (N, 5 n)."""
    return features(arm, motion.torque, motion.velocity)


def bus_power(drive: Drive, feature: Float) -> Float:
    """Sum over the joints, (N,) W; negative where the motors give power back."""
    return np.asarray(feature @ drive.weights())


def supply_power(drive: Drive, bus: Float) -> Float:
    """Power (N,) W that the analyzer sees for ``bus`` (N,) W."""
    return np.asarray(drive.fixed + drawn(bus, 1.0, drive.returned))


def chopper_power(drive: Drive, bus: Float) -> Float:
    """Power (N,) W that the chopper burns for ``bus`` (N,) W."""
    return (1.0 - drive.returned) * np.maximum(-bus, 0.0)
