"""Power that a meter logged into a separate file, on its own clock, beside a recording of the robot."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.tables import read_table
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_motion
from cellwatt_plugins.robot.meter.model import Readings
from cellwatt_plugins.robot.samples import interpolated

log = logging.getLogger(__name__)

FURTHEST: Final = 5.0
"""Largest difference in s between the two clocks."""
USUAL: Final = 0.2
"""Assumed delay in s of a value after its window; the actual delay is found with the torques."""
ROWS: Final = 3
"""Fewest rows of the recording per value: the values of a faster meter are averaged."""
FEWEST: Final = 20
"""Fewest values of a meter within a recording."""
COUNTS: Final = 50
"""Number of rises without a fall that a count of energy has, and no power."""
HOUR: Final = 3600.0
DATED: Final = 1e9
"""Least time in s of a clock that counts from 1970."""
SHORTEST: Final = 4 * FURTHEST
"""Shortest recording in s in which the difference between the clocks can be found."""


def with_meters(recordings: Sequence[Path], meters: Sequence[Path]) -> list[tuple[Path, Path | None]]:
    """Each recording with its meter's file, if there are any. Raises ``RecordingError`` if the numbers of files
    differ."""
    if meters and len(meters) != len(recordings):
        raise RecordingError(
            f"{len(recordings)} recordings but {len(meters)} meters: give one for each, in their order"
        )
    return list(zip_longest(recordings, meters))


def power_beside(path: Path, time: Float, position: Float) -> Float:
    """Power (N,) W in the rows of a recording; each value of the meter's file is held until the next one.

    ``path`` is a table with time and power; ``time`` (N,) s and ``position`` (N, n) rad, NaN where unknown, are the
    recording's. The clocks may differ by up to ``FURTHEST`` s: the difference is found from the motion. Raises
    ``RecordingError``.
    """
    readings = _read(path, float(np.median(np.diff(time))))
    if _inside(readings.time, time).sum() < FEWEST:
        readings = replace(readings, time=readings.time - _apart(path, readings.time, time))
    inside = _inside(readings.time, time)
    if inside.sum() < FEWEST or time[-1] - time[0] < SHORTEST:
        raise RecordingError(
            f"{path}: {int(inside.sum())} values within {FURTHEST:g} s of a recording of {time[-1] - time[0]:.0f} s: "
            f"give files of the same time, of {SHORTEST:g} s or more; its clock runs from {readings.time[0]:.1f} to "
            f"{readings.time[-1]:.1f} s, that of the recording from {time[0]:.1f} to {time[-1]:.1f} s"
        )
    known = Readings(readings.time[inside], readings.value[inside], readings.interval)
    there = np.isfinite(position).all(axis=1)
    course = [_course(time, time[there], position[there])] if there.any() else []
    meter = find([known], course, latest=FURTHEST, earliest=-FURTHEST) if course else None
    if meter is None:
        raise RecordingError(
            f"{path}: its power does not follow the motion of the recording: do the two files belong together, with "
            f"clocks less than {FURTHEST:g} s apart?"
        )
    came = known.time - meter.late + USUAL
    row = np.searchsorted(came, time, side="right") - 1
    return known.value[np.maximum(row, 0)]


def _inside(readings: Float, time: Float) -> NDArray[np.bool_]:
    return np.asarray((readings > time[0] - FURTHEST) & (readings < time[-1] + FURTHEST))


def _apart(path: Path, readings: Float, time: Float) -> float:
    """Difference in s between two clocks that cannot be the same, the meter's less the recording's; 0 if unknown."""
    zones = [h for h in range(-14, 15) if _inside(readings - HOUR * h, time).sum() >= FEWEST]
    if (readings[0] > DATED) != (time[0] > DATED):
        log.warning("%s: one clock counts from 1970, the other does not: both files are taken to begin together", path)
        return float(readings[0] - time[0])
    if time[0] > DATED and len(zones) == 1:
        log.warning("%s: its clock is taken to be %d h ahead, as in another time zone", path, zones[0])
        return HOUR * zones[0]
    return 0.0


def _read(path: Path, step: float) -> Readings:
    """The values of a meter's file, averaged over some rows if the meter is nearly as fast as ``step`` s."""
    table = read_table(path)
    time, power = table.rising_time(), table.whole("supply.power")
    if power is None:
        raise table.lacks("power")
    known = np.isfinite(power)
    time, power = time[known], power[known]
    if len(time) < 2:
        raise RecordingError(f"{path}: the column of the power has no numbers")
    if np.all(np.diff(power) >= 0) and np.sum(np.diff(power) > 0) > COUNTS:
        raise RecordingError(
            f"{path}: the power rises from {power[0]:g} to {power[-1]:g} and never falls: is it the count of an energy "
            "meter? It must be power in W"
        )
    interval = float(np.median(np.diff(time)))
    count = max(1, -(-round(1e6 * ROWS * step) // max(1, round(1e6 * interval))))
    rows = len(time) // count
    means = power[: rows * count].reshape(rows, count).mean(axis=1)
    return Readings(time[count - 1 : rows * count : count], means, interval * count)


def _course(time: Float, known: Float, position: Float) -> Course:
    """Kinds of power from positions alone, which are ``known`` at some of the times."""
    even = np.linspace(time[0], time[-1], len(time))
    path = interpolated(even, known, position)
    return Course(even, kinds_of_motion(path, float(even[1] - even[0])))
