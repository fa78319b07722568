"""One recording as stretches of motion on an even grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.tables import Table, read_table
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.motion import differentiate, rates, smooth

Float = NDArray[np.float64]

HOLE: Final = 3.0
"""Steps without a sample at which a stretch ends."""
SHORTEST: Final = 3.0
"""s of a stretch, at least."""
FEWEST: Final = 8
"""Samples of a stretch, at least."""
SLOWEST: Final = 9.5
"""Hz, at least."""
BANDWIDTH: Final = 10.0
"""Hz of motion that is kept."""


@dataclass(frozen=True)
class Stretch:
    """N samples, evenly spaced; n joints."""

    time: Float
    """(N,) s."""
    position: Float
    """(N, n) rad."""
    velocity: Float
    """(N, n) rad/s."""
    acceleration: Float
    """(N, n) rad/s²."""
    torque: Float
    """(N, n) Nm, as the robot gives it."""
    temperature: Float | None
    """(n,) °C, the mean of each joint."""
    power: Float | None
    """(N,) W."""

    @property
    def step(self) -> float:
        """Seconds between samples."""
        return float(self.time[1] - self.time[0])


def read_stretches(path: Path, robot: RobotDescription) -> list[Stretch]:
    """Read a recording. Raises ``RecordingError``, or ``ConfigError`` where the robot lacks a key."""
    table = read_table(path)
    joints = len(robot.joints)
    position, torque = table.needed("position", joints), _torque(table, robot)
    time = table.rising_time()
    step = float(np.median(np.diff(time)))
    if step > 1 / SLOWEST:
        raise RecordingError(f"{path}: {1 / step:.3g} samples a second, expected 10 or more")
    whole = np.isfinite(position).all(axis=1) & np.isfinite(torque).all(axis=1)
    if not whole.any():
        raise RecordingError(f"{path}: position or torque is empty in every row")
    kept = np.flatnonzero(whole)
    late = np.flatnonzero(np.diff(time[kept]) > HOLE * step) + 1
    out = [
        _even(table, rows, time, position, torque, step)
        for rows in np.split(kept, late)
        if len(rows) > FEWEST and time[rows[-1]] - time[rows[0]] >= SHORTEST
    ]
    if not out:
        raise RecordingError(f"{path}: no {SHORTEST:g} s in a row of positions and torques")
    return out


def _even(table: Table, rows: NDArray[np.intp], time: Float, position: Float, torque: Float, step: float) -> Stretch:
    count = int((time[rows[-1]] - time[rows[0]]) / step + 0.5) + 1
    even = time[rows[0]] + step * np.arange(count)

    def placed(values: Float) -> Float:
        columns = values[rows].reshape(len(rows), -1)
        if len(even) == len(rows) and np.abs(even - time[rows]).max() < 0.05 * step:
            return np.asarray(columns.reshape(values[rows].shape))
        there = np.column_stack([np.interp(even, time[rows], column) for column in columns.T])
        return there if values.ndim > 1 else there[:, 0]

    encoders = placed(position)
    speed = table.joints("velocity")
    if speed is not None and speed.shape == position.shape and np.isfinite(speed[rows]).all():
        q, qd = smooth(encoders, step, BANDWIDTH), smooth(placed(speed), step, BANDWIDTH)
        qdd = differentiate(qd, step)[0]
    else:
        q, qd, qdd = rates(encoders, step, BANDWIDTH)
    return Stretch(
        even, q, qd, qdd, placed(torque), _temperature(table, rows, position.shape[1]), _power(table, rows, placed)
    )


def _temperature(table: Table, rows: NDArray[np.intp], joints: int) -> Float | None:
    found = table.joints("temperature")
    if found is None or found.shape[1] < joints:
        return None
    inside = found[rows][:, :joints]
    known = np.isfinite(inside)
    if not known.any(axis=0).all():
        return None
    return np.asarray(np.where(known, inside, 0.0).sum(axis=0) / known.sum(axis=0))


def _power(table: Table, rows: NDArray[np.intp], placed: Callable[[Float], Float]) -> Float | None:
    power = table.whole("supply.power")
    if power is None or not np.isfinite(power[rows]).all():
        return None
    return placed(power)


def _torque(table: Table, robot: RobotDescription) -> Float:
    """Torque (N, n) Nm as recorded, or from currents or shares of the rated torque."""
    joints = len(robot.joints)
    for quantity, key in (("torque", ""), ("current", "torque_constant"), ("torque_ratio", "rated_torque")):
        found = table.joints(quantity)
        if found is None or found.shape[1] < joints or not np.isfinite(found).any():
            continue
        if not key:
            return found[:, :joints]
        factor = robot.column(key)
        if not (factor > 0).all():
            lacking = robot.joints[int(np.argmin(factor))].name
            raise ConfigError(f"{robot.robot}: {lacking} has no {key}, which {table.path} needs: add it to robot.yaml")
        return found[:, :joints] * factor
    raise table.lacks("tau_1")
