"""What the motors draw from the DC bus, and what the analyzer sees of it.

The bus of all joints is shared. It takes the sum over the joints of mechanical power, copper loss R I², loss in the
drive's switches k_sw |I| and iron loss, by eddy currents k_fe θ̇² and by hysteresis k_h |θ̇| (ECDP, III-D). Where
the sum is negative the supply cannot take it back: the electronics use the share ``returned`` of it, which the
analyzer misses in its reading, and the chopper burns the rest. The paper's estimate of E_RB by negative mechanical
power (eq. 11) leaves out what the motors themselves lose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.arm import Arm
from cellwatt_plugins.energy.recordings import Motion

Float = NDArray[np.float64]

KINDS = 5
"""Features of a joint: mechanical power, copper, switching, iron, hysteresis."""
STILL = 5e-3
"""rad/s: a slower joint stands, and its noise is not hysteresis."""


@dataclass(frozen=True)
class Drive:
    """Parameters of an arm's supply; (n,) each where a joint has its own."""

    fixed: float
    """Power at rest with brakes released and no torque: electronics and brakes, W."""
    torque: Float
    """What the robot's torque is to be multiplied by."""
    copper: Float
    """Winding resistance as a multiple of the described one, at the described torque constant and given torque."""
    switching: Float
    """W/A."""
    iron: Float
    """W s²/rad² at the joint side: eddy currents."""
    hysteresis: Float
    """W s/rad at the joint side."""
    returned: float
    """Share of the braking power on the bus that the electronics use, 0 … 1."""

    def weights(self) -> Float:
        """Weights (5 n,) of the features in the power on the bus."""
        return np.concatenate([self.torque, self.copper, self.switching, self.iron, self.hysteresis])


def features(arm: Arm, torque: Float, velocity: Float) -> Float:
    """(N, 5 n): τ_i θ̇_i (W), R_i I_i² (W), |I_i| (A), θ̇_i² (rad²/s²), |θ̇_i| (rad/s).

    Of torque (N, n) Nm as given and velocity (N, n) rad/s.
    """
    current = torque / arm.column("torque_constant")
    copper = arm.column("winding_resistance") * current**2
    speed = np.abs(velocity)
    turning = np.where(speed > STILL, speed, 0.0)
    return np.hstack([torque * velocity, copper, np.abs(current), velocity**2, turning])


def motion_features(arm: Arm, motion: Motion) -> Float:
    """``features`` of a recorded motion, (N, 5 n)."""
    return features(arm, motion.torque, motion.velocity)


def bus_power(drive: Drive, feature: Float) -> Float:
    """Sum over the joints, (N,) W; negative where the motors give power back."""
    return np.asarray(feature @ drive.weights())


def supply_power(drive: Drive, bus: Float) -> Float:
    """What the analyzer sees, (N,) W, for ``bus`` (N,) W."""
    return drive.fixed + np.maximum(bus, 0.0) + drive.returned * np.minimum(bus, 0.0)


def chopper_power(drive: Drive, bus: Float) -> Float:
    """What the chopper burns, (N,) W, for ``bus`` (N,) W."""
    return (1.0 - drive.returned) * np.maximum(-bus, 0.0)
