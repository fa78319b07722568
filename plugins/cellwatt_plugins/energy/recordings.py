"""Reads the files of a campaign, recorded by the analyzer and the robot, each on its own clock."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt.tables import Table, read_table
from cellwatt_plugins.robot.samples import interpolated

_RUN = re.compile(r"(?P<speed>\d+(?:\.\d+)?)_(?P<payload>\d+(?:\.\d+)?)kg")
_ENDINGS = (".parquet", ".csv")
FEWEST = 20
"""Fewest rows of a file."""


@dataclass(frozen=True)
class _Trace:
    """What one device reported at times ``time`` (N,) s of its own clock; ``place`` is the file's name for messages."""

    place: str
    time: Float

    @cached_property
    def step(self) -> float:
        """Sample interval, s (median, so that holes do not count)."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class PowerTrace(_Trace):
    """Power measured by the analyzer; each value is the mean over a window of one step.

    ``time`` is the middle of each value's window, ``power`` (N,) W.
    """

    power: Float


@dataclass(frozen=True)
class RobotTrace(_Trace):
    """Motion and torque reported by the robot, evenly spaced: ``position`` rad, ``velocity`` rad/s and ``torque`` Nm
    (N, n)."""

    position: Float
    velocity: Float
    torque: Float


@dataclass(frozen=True)
class Recorded:
    """One run of a campaign: repetitions of one path at one ``speed`` (mm/s) with one ``payload`` (kg).

    Its ``name`` contains both: ``SPEED_PAYLOADkg``, e.g. ``100_5kg``.
    """

    name: str
    speed: float
    payload: float
    motion: RobotTrace
    reading: PowerTrace


def read_reading(path: Path) -> PowerTrace:
    """Read time and power of a table. Raises ``RecordingError``."""
    table = read_table(path)
    power = table.whole("supply.power")
    if power is None:
        raise table.lacks("power")
    return PowerTrace(str(path), *_whole(table, power))


def read_motion(path: Path, joints: Sequence[str]) -> RobotTrace:
    """Read time, positions, velocities and torques of a table; ``joints`` are the joints' names.

    Raises ``RecordingError``.
    """
    table = read_table(path, joints)
    columns = (table.needed(quantity, len(joints)) for quantity in ("position", "velocity", "torque"))
    time, position, velocity, torque = _whole(table, *columns)
    steps = np.diff(time)
    if steps.max() > 5 * np.median(steps):
        at = float(time[int(np.argmax(steps))])
        raise RecordingError(f"{path}: no samples for {steps.max():.2f} s after t = {at:.2f} s: record this run again")
    even = np.arange(time[0], time[-1], float(np.median(steps)))
    if len(even) != len(time) or np.abs(even - time).max() > 0.2 * np.median(steps):
        position, velocity, torque = (interpolated(even, time, v) for v in (position, velocity, torque))
        time = even
    return RobotTrace(str(path), time, position, velocity, torque)


def read_runs(folder: Path, joints: Sequence[str]) -> list[Recorded]:
    """Read all runs of a folder, by payload and speed. Raises ``RecordingError`` if a file of a pair is missing."""
    files = sorted(p for p in folder.iterdir() if p.suffix in _ENDINGS) if folder.is_dir() else []
    pairs = [_pair(p) for p in files if p.name.removesuffix(p.suffix).endswith(".robot")]
    if not pairs:
        raise RecordingError(f"{folder}: no runs in this folder; expected files like 100_5kg.robot.parquet")
    for (name, *_, one, _), (other, *_, two, _) in pairwise(pairs):
        if name == other:
            raise RecordingError(f"{two}: the same run as {one.name}: keep one of them")
    runs = spread(_read, pairs, "reading runs", shared=tuple(joints))
    return sorted(runs, key=lambda run: (run.payload, run.speed))


_Pair = tuple[str, float, float, Path, Path]
"""Name, speed and payload of a run, the robot's file and the analyzer's."""


def _pair(path: Path) -> _Pair:
    name = path.name.removesuffix(path.suffix).removesuffix(".robot")
    match = _RUN.fullmatch(name)
    if match is None:
        raise RecordingError(f"{path}: name it SPEED_PAYLOADkg.robot{path.suffix}, like 100_5kg.robot{path.suffix}")
    other = next((p for e in _ENDINGS if (p := path.with_name(f"{name}.analyzer{e}")).exists()), None)
    if other is None:
        raise RecordingError(f"{path}: the analyzer's file {name}.analyzer{path.suffix} is not in the same folder")
    return name, float(match["speed"]), float(match["payload"]), path, other


def _read(pair: _Pair, joints: Sequence[str]) -> Recorded:
    name, speed, payload, robot, analyzer = pair
    return Recorded(name, speed, payload, read_motion(robot, joints), read_reading(analyzer))


def _whole(table: Table, *columns: Float) -> list[Float]:
    """Time and columns in the rows without a missing value. Raises ``RecordingError`` if these are too few."""
    time = table.rising_time()
    whole = np.isfinite(np.column_stack(columns)).all(axis=1)
    if whole.sum() < FEWEST:
        raise RecordingError(f"{table.path}: {whole.sum()} rows without a missing value, expected {FEWEST} or more")
    return [values[whole] for values in (time, *columns)]
