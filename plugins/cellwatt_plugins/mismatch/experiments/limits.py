"""Limits of an arm, and the part of them in which it has been seen to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.input.run import Motion
from cellwatt_plugins.robot.effects.states import States

Float = NDArray[np.float64]

TO_FULL_SPEED = 1.0
"""s in which an arm is taken to reach its full speed, where the recordings do not show that it can do better."""
SHARE = 0.8
"""Share of the velocity and acceleration limits that experiments use."""
MARGIN = 0.05
"""rad (or m) that experiments keep from the position limits."""
LEAST_REACH = 0.5
"""rad to each side within which a joint may be moved although the recordings did not."""
SLOWEST = 0.5
"""rad/s that a joint may do where no limit is stated and the recordings hardly move it."""
AGAIN = 1.05
"""Acceleration and torque, relative to the greatest recorded, with which the recorded motion can be repeated."""
ROUNDING = 1e-6


@dataclass(frozen=True)
class Limits:
    """Limits of n joints, (n,) each."""

    lower: Float
    """rad."""
    upper: Float
    velocity: Float
    """rad/s."""
    acceleration: Float
    """rad/s²."""
    torque: Float
    """Nm."""
    home: Float
    """rad: where experiments start and end, the pose in which the first recording begins."""
    low: Float
    """rad: experiments stay above."""
    high: Float
    """rad: experiments stay below."""

    @property
    def cruise(self) -> Float:
        """Velocity (n,) rad/s that experiments use."""
        return SHARE * self.velocity

    @property
    def ramp(self) -> Float:
        """Acceleration (n,) rad/s² that experiments use."""
        return SHARE * self.acceleration

    def broken(self, motion: Motion, torque: Float) -> str | None:
        """Name the limit that a motion with ``torque`` (N, n) Nm breaks; None if it keeps all."""
        checks = (
            ("position", self.lower - motion.position),
            ("position", motion.position - self.upper),
            ("velocity", np.abs(motion.velocity) - self.velocity),
            ("acceleration", np.abs(motion.acceleration) - self.acceleration),
            ("torque", np.abs(torque) - self.torque),
        )
        for name, over in checks:
            worst = np.max(over, axis=0)
            if np.any(worst > ROUNDING):
                return f"joint {int(np.argmax(worst)) + 1} would break its {name} limit"
        return None


def limits_of(states: Sequence[States]) -> Limits:
    """Limits of the recorded arm: stated ones (robot.yaml before the URDF), else what the recordings show.

    A limit that the recordings exceed is not the arm's: what was recorded is always within the limits.
    """
    arm = states[0].arm
    (lower, upper), velocity, effort = arm.limits.T, arm.velocity_limits, arm.body.torque_limits
    places = np.concatenate([s.q for s in states])
    least, most = np.min(places, axis=0), np.max(places, axis=0)
    lower, upper = np.minimum(lower, least), np.maximum(upper, most)
    fastest = _greatest([s.qd for s in states])
    velocity = np.maximum(np.where(velocity > 0, velocity, SLOWEST), fastest)
    acceleration = np.maximum(velocity / TO_FULL_SPEED, AGAIN * _greatest([s.qdd for s in states]))
    torque = np.maximum(np.where(effort > 0, effort, np.inf), AGAIN * _greatest([s.torque for s in states]))
    home = states[0].q[0]
    low = np.maximum(np.minimum(least, home - LEAST_REACH), np.minimum(lower + MARGIN, least))
    high = np.minimum(np.maximum(most, home + LEAST_REACH), np.maximum(upper - MARGIN, most))
    return Limits(lower, upper, velocity, acceleration, torque, home, low, high)


def _greatest(courses: Sequence[Float]) -> Float:
    """Greatest absolute value (n,) of all runs."""
    return np.asarray(np.max([np.max(np.abs(course), axis=0) for course in courses], axis=0))
