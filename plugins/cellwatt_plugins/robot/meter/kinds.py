"""Kinds of power that an arm draws, from its motion and torques; their weights are unknown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.motion import rates

MOVES: Final = 0.01
"""Velocity in rad/s above which a joint moves."""


@dataclass(frozen=True)
class Course:
    """Kinds of power along a segment of rows."""

    time: Float
    """(N,) s, evenly spaced."""
    kinds: Float
    """(N, k)."""


def kinds_of_motion(position: Float, step: float) -> Float:
    """Kinds (N, 4 n + 1) from positions (N, n) rad every ``step`` s alone: power that lifts and drives each joint."""
    _, qd, qdd = rates(position, step)
    moving = np.any(np.abs(qd) > MOVES, axis=1)
    return np.column_stack([qd, np.abs(qd), qd**2, qd * qdd, moving])


def kinds_of_power(torque: Float, qd: Float) -> Float:
    """Kinds (N, 3 n + 3) from torques (N, n) Nm and velocities (N, n) rad/s.

    For each joint mechanical power, heat by torque squared, and a loss that grows with its speed; for the bus the power
    drawn and the power returned; and brakes, which are released while the arm moves.
    """
    mechanical = torque * qd
    bus = mechanical.sum(axis=1)
    moving = np.any(np.abs(qd) > MOVES, axis=1)
    return np.column_stack([mechanical, torque**2, np.abs(qd), np.maximum(bus, 0), np.minimum(bus, 0), moving])
