"""Files of a campaign: what the analyzer and the robot recorded, each on its own clock."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.files import check_file
from cellwatt.parquet import read_parquet

Float = NDArray[np.float64]

_RUN = re.compile(r"(?P<speed>\d+(?:\.\d+)?)_(?P<payload>\d+(?:\.\d+)?)kg")
_ENDINGS = (".parquet", ".csv")


@dataclass(frozen=True)
class Reading:
    """What the analyzer measured; each value is the mean over the time to its neighbours."""

    place: str
    """What messages call it."""
    time: Float
    """(N,) s, middle of each value's time, on the analyzer's clock."""
    power: Float
    """(N,) W."""

    @property
    def step(self) -> float:
        """Seconds that one value stands for."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class Motion:
    """What the robot said, evenly spaced on its own clock."""

    place: str
    time: Float
    """(N,) s."""
    position: Float
    """(N, n) rad."""
    velocity: Float
    """(N, n) rad/s."""
    torque: Float
    """(N, n) Nm, as the robot gives it."""

    @property
    def step(self) -> float:
        """Seconds between samples, whatever is missing in between."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class Recorded:
    """One run of a campaign: repetitions of one path at one speed with one payload."""

    name: str
    """``SPEED_PAYLOADkg``, e.g. ``100_5kg``."""
    speed: float
    """mm/s, as the name says."""
    payload: float
    """kg."""
    motion: Motion
    reading: Reading


def read_reading(path: Path) -> Reading:
    """Columns t (s) and power (W) of a Parquet or CSV file. Raises ``RecordingError``."""
    time, (power,) = _columns(path, ["power"])
    return Reading(str(path), time, power)


def read_motion(path: Path, joints: int) -> Motion:
    """Columns t, q_1 …, qd_1 …, tau_1 … of a Parquet or CSV file. Raises ``RecordingError``."""
    names = [f"{stem}_{i + 1}" for stem in ("q", "qd", "tau") for i in range(joints)]
    time, values = _columns(path, names)
    position, velocity, torque = np.stack(values, axis=1).reshape(len(time), 3, joints).transpose(1, 0, 2)
    steps = np.diff(time)
    if steps.max() > 5 * np.median(steps):
        at = float(time[int(np.argmax(steps))])
        raise RecordingError(f"{path}: no samples for {steps.max():.2f} s after t = {at:.2f} s: record this run again")
    even = np.arange(time[0], time[-1], float(np.median(steps)))
    if len(even) != len(time) or np.abs(even - time).max() > 0.2 * np.median(steps):
        position, velocity, torque = (_on_grid(even, time, v) for v in (position, velocity, torque))
        time = even
    return Motion(str(path), time, position, velocity, torque)


def read_runs(folder: Path, joints: int) -> list[Recorded]:
    """All runs of a folder, by payload and speed. Raises ``RecordingError`` where a file of a pair is missing."""
    runs = []
    files = sorted(p for p in folder.iterdir() if p.suffix in _ENDINGS) if folder.is_dir() else []
    for path in files:
        name, _, kind = path.name.removesuffix(path.suffix).rpartition(".")
        if kind != "robot":
            continue
        match = _RUN.fullmatch(name)
        if match is None:
            raise RecordingError(f"{path}: call it SPEED_PAYLOADkg.robot{path.suffix}, like 100_5kg.robot{path.suffix}")
        other = next((p for e in _ENDINGS if (p := folder / f"{name}.analyzer{e}").exists()), None)
        if other is None:
            raise RecordingError(f"{path}: the analyzer's file {name}.analyzer{path.suffix} is not beside it")
        speed, payload = float(match["speed"]), float(match["payload"])
        runs.append(Recorded(name, speed, payload, read_motion(path, joints), read_reading(other)))
    if not runs:
        raise RecordingError(f"{folder}: no runs there; expected files like 100_5kg.robot.parquet")
    return sorted(runs, key=lambda run: (run.payload, run.speed))


def _on_grid(even: Float, time: Float, values: Float) -> Float:
    return np.stack([np.interp(even, time, column) for column in values.T], axis=1)


def _columns(path: Path, names: Sequence[str]) -> tuple[Float, list[Float]]:
    try:
        check_file(path)
        table = read_parquet(path) if path.suffix == ".parquet" else pa.csv.read_csv(path)
        there = table.column_names
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error).splitlines()[0]}") from error
    except (pa.ArrowException, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read as a table: {str(error).splitlines()[0]}") from error
    if missing := [name for name in ("t", *names) if name not in there]:
        raise RecordingError(f"{path}: no column {', '.join(missing[:4])}; there are {', '.join(there[:8])}")
    if twice := [name for name in ("t", *names) if there.count(name) > 1]:
        raise RecordingError(f"{path}: two columns are called {twice[0]!r}")
    try:
        time, *values = (np.asarray(table[name].to_numpy(), np.float64) for name in ("t", *names))
    except (TypeError, ValueError, pa.ArrowException) as error:
        raise RecordingError(f"{path}: holds something else than numbers: {error}") from error
    _check(path, time, dict(zip(names, values, strict=True)))
    return time, values


def _check(path: Path, time: Float, columns: dict[str, Float]) -> None:
    if len(time) < 20:
        raise RecordingError(f"{path}: {len(time)} rows: too few")
    if not np.all(np.diff(time) > 0):
        raise RecordingError(f"{path}: its times do not rise after t = {time[np.argmax(np.diff(time) <= 0)]:.3f} s")
    for name, values in columns.items():
        if not np.isfinite(values).all():
            at = time[np.argmax(~np.isfinite(values))]
            raise RecordingError(f"{path}: {name} is empty at t = {at:.2f} s: record it again, or cut it there")
