"""Samples of an arm from tables: torques from any recorded quantity, and any quantity interpolated to other times."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Bool, Float
from cellwatt.errors import ConfigError
from cellwatt.tables import Table
from cellwatt_plugins.robot.description import RobotDescription

EFFORTS: Final = {"torque": "", "actuator_force": "", "torque_ratio": "rated_torque", "current": "torque_constant"}
"""Quantities that give a joint's torque, the best first, and the key of the description that each is multiplied by."""

NO_TORQUE: Final = 0.02
"""Share of a joint's largest torque up to which it has none."""
LARGEST, SPARSE = 2_000_000, 20
"""Most points of an even grid: this number, or this multiple of the table's rows if that is more."""


class Even:
    """Something with samples on an even grid."""

    time: Float

    @property
    def step(self) -> float:
        """Seconds between samples."""
        return float((self.time[-1] - self.time[0]) / max(1, len(self.time) - 1))


def torque_in(table: Table, robot: RobotDescription) -> Float:
    """Torques (N, n) Nm of a table as they are recorded, or from shares of the rated torques, or from currents.

    Raises ``RecordingError`` if the table has none of them, ``ConfigError`` if the description lacks the key.
    """
    joints = len(robot.joints)
    for quantity in EFFORTS:
        found = table.joints(quantity)
        if found is None or found.shape[1] < joints or not np.isfinite(found).any():
            continue
        return in_torques(found[:, :joints], quantity, robot, str(table.path))
    return table.needed("torque", joints)


def in_torques(values: Float, quantity: str, robot: RobotDescription, place: str) -> Float:
    """Torques (N, n) Nm of the ``values`` of a quantity of ``EFFORTS``; NaN stays. Raises ``ConfigError``."""
    key = EFFORTS[quantity]
    units = robot.column(key) if key else np.ones(len(robot.joints))
    recorded = np.isfinite(values).any(axis=0)
    if unknown := [joint.name for joint, needed in zip(robot.joints, recorded & (units == 0), strict=True) if needed]:
        raise ConfigError(
            f"{place}: its {quantity} needs the {key} of {', '.join(unknown)}: write it into the robot's description, "
            "at the joint side"
        )
    return np.asarray(values * units)


def unpowered(torque: Float, least: Float | float = 0.0) -> Bool:
    """True (N,) where no joint of ``torque`` (N, n) Nm has more than a small share of its largest, or than ``least``.

    At rest, brakes then hold the arm, and its drives or sensors are off.
    """
    size = np.abs(torque)
    return np.asarray(np.all(size <= np.maximum(NO_TORQUE * np.max(size, axis=0), least), axis=1), np.bool_)


def most_points(rows: int) -> int:
    """Most points of an even grid for a table of ``rows``; a larger one consists mostly of a jump of the clock."""
    return max(LARGEST, SPARSE * rows)


def interpolated(when: Float, time: Float, values: Float) -> Float:
    """Values (N,) or (N, k) at ``time`` (N,) s interpolated at times ``when`` (M,) s: (M,) or (M, k)."""
    if values.ndim == 1:
        return np.asarray(np.interp(when, time, values))
    return np.column_stack([np.interp(when, time, column) for column in values.T])
