"""Reads one recording as stretches without holes on an even grid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.tables import Table, read_table
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import differentiate, rates, smooth
from cellwatt_plugins.robot.samples import Even, interpolated, torque_in

HOLE: Final = 3.0
"""Longest interval between samples of a stretch, in steps."""
SHORTEST: Final = 3.0
"""Shortest stretch, s."""
FEWEST: Final = 8
"""Fewest samples of a stretch."""
SLOWEST: Final = 9.5
"""Lowest sample rate, Hz."""
BANDWIDTH: Final = 10.0
"""Bandwidth to which motion is smoothed, Hz."""


@dataclass(frozen=True)
class Stretch(Even):
    """N evenly spaced samples of n joints: ``time`` (N,) s; rad, rad/s, rad/s² and Nm reported by the robot (N, n).

    ``temperature`` (n,) °C is the mean of each joint, ``power`` (N,) W.
    """

    time: Float
    position: Float
    velocity: Float
    acceleration: Float
    torque: Float
    temperature: Float | None
    power: Float | None
    levers: Float
    """(n,): see ``Body.levers``."""


def read_stretches(path: Path, arm: Arm) -> list[Stretch]:
    """Read a recording. Raises ``RecordingError``, or ``ConfigError`` if the robot's description lacks a key."""
    table = read_table(path, arm.description.names)
    position, torque = table.needed("position", arm.joints), torque_in(table, arm.description)
    time = table.rising_time()
    step = float(np.median(np.diff(time)))
    if step > 1 / SLOWEST:
        raise RecordingError(f"{path}: {1 / step:.3g} samples a second, expected 10 or more")
    whole = np.isfinite(np.hstack([position, torque])).all(axis=1)
    if not whole.any():
        raise RecordingError(f"{path}: position or torque is empty in every row")
    usable = np.flatnonzero(whole)
    late = np.flatnonzero(np.diff(time[usable]) > HOLE * step) + 1
    out = [
        _even(table, rows, position, torque, step, arm.body.levers)
        for rows in np.split(usable, late)
        if len(rows) > FEWEST and time[rows[-1]] - time[rows[0]] >= SHORTEST
    ]
    if not out:
        raise RecordingError(f"{path}: no {SHORTEST:g} s in a row of positions and torques")
    return out


def _even(table: Table, rows: NDArray[np.intp], position: Float, torque: Float, step: float, levers: Float) -> Stretch:
    time, speed, power = table.time[rows], table.joints("velocity"), table.whole("supply.power")
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 0.5) + 1)
    as_it_is = len(even) == len(time) and np.abs(even - time).max() < 0.05 * step

    def placed(values: Float) -> Float:
        return values[rows] if as_it_is else interpolated(even, time, values[rows])

    if speed is not None and speed.shape == position.shape and np.isfinite(speed[rows]).all():
        q, qd = smooth(placed(position), step, BANDWIDTH), smooth(placed(speed), step, BANDWIDTH)
        qdd = differentiate(qd, step)[0]
    else:
        q, qd, qdd = rates(placed(position), step, BANDWIDTH)
    watts = placed(power) if power is not None and np.isfinite(power[rows]).all() else None
    return Stretch(even, q, qd, qdd, placed(torque), _temperature(table, rows, position.shape[1]), watts, levers)


def _temperature(table: Table, rows: NDArray[np.intp], joints: int) -> Float | None:
    found = table.joints("temperature")
    if found is None or found.shape[1] < joints or not np.isfinite(found[rows, :joints]).any(axis=0).all():
        return None
    return np.asarray(np.nanmean(found[rows, :joints], axis=0))
