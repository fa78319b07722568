"""Training data of a power model: moves of an arm with the current of its joints and the power of its supply."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from cellwatt.arrays import Float, joined, rows_of
from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt.tables import Table, read_table, usual
from cellwatt_plugins.models.predict import starts_of
from cellwatt_plugins.robot.meter.file import power_beside, with_meters
from cellwatt_plugins.robot.meter.held import onto
from cellwatt_plugins.robot.meter.model import Meter
from cellwatt_plugins.robot.samples import interpolated

log = logging.getLogger(__name__)

POWER = ("supply.power", "bus.power")
"""Channels of the power that a model may be trained on; the first that varies is used."""
UNEVEN = 0.02
"""Largest relative difference between steps; rows with larger ones are interpolated to an even grid."""
HOLE = 3.5
"""Steps between two rows above which a move ends; across shorter holes, rows are interpolated."""
SHORTEST = 10
"""Fewest rows of a move."""


@dataclass(frozen=True)
class Moves:
    """N rows of n joints; the rows of a move are consecutive, with an even step."""

    move: NDArray[np.int64]
    """(N,) number of the move, rising from 0."""
    time: Float
    """(N,) s."""
    q: Float
    """(N, n) rad."""
    qd: Float
    """(N, n) rad/s."""
    current: Float
    """(N, n) A; NaN where not measured."""
    power: Float
    """(N,) W; NaN if not measured."""
    payload: Float | None = None
    """(N,) kg at the flange, if recorded."""
    temperature: Float | None = None
    """(N, n) °C of the joints, if recorded."""
    came: Float | None = None
    """(N,) s when a row's value came from a slow meter; NaN in rows that repeat a value."""
    meter: Meter | None = None
    """The slow meter that measured the power."""

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.q.shape[1])

    @property
    def count(self) -> int:
        """Number of moves."""
        return int(self.move[-1]) + 1

    @property
    def step(self) -> float:
        """Time between rows, s."""
        steps = np.diff(self.time)[np.diff(self.move) == 0]
        return float(np.median(steps))

    def bounds(self) -> list[tuple[int, int]]:
        """First row of each move, and the row after its last."""
        edges = np.flatnonzero(np.diff(self.move, prepend=-1, append=-1))
        return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))

    def where(self, rows: NDArray[np.bool_]) -> Moves:
        """Some of the rows, their moves renumbered; rows on both sides of a hole are moves of their own."""
        kept = np.flatnonzero(rows)
        starts = (np.diff(kept, prepend=-2) != 1) | (np.diff(self.move[kept], prepend=-1) != 0)
        return replace(rows_of(self, rows), move=np.cumsum(starts) - 1)

    def around(self, rows: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
        """``rows`` (N,) and those of the same moves that lie within ``reach`` rows of them."""
        return np.isin(self.move, self.move[rows]) & maximum_filter1d(rows, 2 * reach + 1)

    def unmeasured(self, rows: NDArray[np.bool_]) -> Moves:
        """The same without the currents of some rows, and without their power unless it is from a slow meter."""
        power = np.where(rows & (self.meter is None), np.nan, self.power)
        return replace(self, current=np.where(rows[:, None], np.nan, self.current), power=power)

    def only(self, moves: Iterable[int]) -> Moves:
        """The moves with these numbers, renumbered."""
        return self.where(np.isin(self.move, list(moves)))


def read_moves(paths: Sequence[Path], joints: Sequence[str], meters: Sequence[Path] = ()) -> Moves:
    """Moves of one or several tables: Parquet, CSV, or recordings of cellwatt; ``joints`` are the joints' names.

    A move ends where ``move`` changes, time jumps, or a position or velocity is missing. ``meters`` are the files with
    the power of the tables, in the same order. Raises ``RecordingError`` if a column is missing, or no move remains.
    """
    found = spread(_parts, with_meters(paths, meters), "reading recordings", shared=tuple(joints))
    parts = [part for of_file in found for part in of_file]
    if not parts:
        raise RecordingError(f"{paths[0]}: no {SHORTEST} consecutive rows with position and velocity of all joints")
    for name in ("payload", "temperature"):
        lacking = [path for path, own in zip(paths, found, strict=True) if any(getattr(p, name) is None for p in own)]
        if lacking and any(getattr(part, name) is not None for part in parts):
            log.warning("%s: no %s: that of the other files is not used", lacking[0], name)
            unknown: dict[str, Any] = {name: None}
            parts = [replace(part, **unknown) for part in parts]
    steps = np.concatenate([np.full(len(part), part.step) for part in parts])
    step = float(np.quantile(steps, 0.5, method="lower"))  # that of most rows, not a mean of two files' steps
    numbered = [replace(part, move=np.full(len(part), i)) for i, part in enumerate(_even(p, step) for p in parts)]
    return joined(numbered)


def _parts(file: tuple[Path, Path | None], names: Sequence[str]) -> list[Moves]:
    """The moves of a file and its meter's file, each numbered 0."""
    path, meter = file
    table, joints = read_table(path, names), len(names)
    time = table.time
    metered = None if meter is None else power_beside(meter, table.rising_time(), table.needed("position", joints))
    found = _quantities(table, joints, metered)
    whole = np.asarray(np.isfinite(np.column_stack([found["q"], found["qd"]])).all(axis=1))
    starts = np.flatnonzero(starts_of(table.at(whole), HOLE))
    pieces = [rows for rows in np.split(np.flatnonzero(whole), starts[1:]) if len(rows) >= SHORTEST]
    if not pieces and np.sum(whole) >= SHORTEST:
        table.rising_time()  # rounded times repeat, and a time that repeats ends a move
    if lost := len(table) - sum(map(len, pieces)):
        log.warning(
            "%s: %d of %d rows are left out: they lack a position or velocity, or are fewer than %d between two gaps "
            "or repeated times",
            *(path, lost, len(table), SHORTEST),
        )
    return [
        Moves(np.zeros(len(rows), np.int64), time[rows], **{name: value[rows] for name, value in found.items()})
        for rows in pieces
    ]


def _quantities(table: Table, joints: int, metered: Float | None) -> dict[str, Any]:
    """The fields of ``Moves``, other than the time, that a file has."""
    known = [metered] if metered is not None else [table.whole(name) for name in POWER]
    power = next((each for each in known if each is not None and _varies(each)), None)
    if power is None:
        power = np.full(len(table), np.nan)
        if any(each is not None for each in known):
            log.warning("%s: power: no number, or always the same: not used", table.path)
    current, payload = _currents(table, joints), table.whole("tool.payload")
    if not np.isfinite(current).any() and not np.isfinite(power).any():
        raise table.lacks(f"power, nor of {usual('current', 1)} …, that holds numbers which vary")
    found = {
        "q": table.needed("position", joints),
        "qd": table.needed("velocity", joints),
        "current": current,
        "power": power,
    }
    temperature = table.joints("temperature")
    if payload is not None and np.isfinite(payload).any():
        found["payload"] = _filled(payload)
    if temperature is not None and temperature.shape[1] >= joints:
        columns = temperature.T[:joints]
        if all(np.isfinite(column).any() for column in columns):
            found["temperature"] = np.column_stack([_filled(column) for column in columns])
    return found


def _currents(table: Table, joints: int) -> Float:
    """The joints' currents (N, joints) A: NaN if the file lacks them, or if a column holds nothing or never varies."""
    found = table.joints("current")
    if found is None or found.shape[1] < joints:
        return np.full((len(table), joints), np.nan)
    dead = [j for j, column in enumerate(found.T[:joints]) if not _varies(column)]
    if dead:
        names = ", ".join(table.joint_names("current")[j] for j in dead)
        log.warning("%s: %s: no number, or always the same: not used", table.path, names)
    return np.where(np.isin(np.arange(joints), dead), np.nan, found[:, :joints])


def _varies(values: Float) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known) and np.ptp(known) > 0)


def _filled(values: Float) -> Float:
    """Values (N,) in which a blank cell repeats the value before it, or the first one."""
    known = np.flatnonzero(np.isfinite(values))
    rows: Float = values[known[np.maximum(np.searchsorted(known, np.arange(len(values)), "right") - 1, 0)]]
    return rows


def _even(part: Moves, step: float) -> Moves:
    """The same move on an even grid of ``step`` s; unchanged if its steps are even."""
    steps = np.diff(part.time)
    if np.abs(steps / step - 1).max(initial=0.0) < UNEVEN:
        return part
    time = np.arange(part.time[0], part.time[-1] + 1e-9, step)
    names = [f.name for f in fields(Moves) if f.name not in ("move", "time") and getattr(part, f.name) is not None]
    values: dict[str, Any] = {name: interpolated(time, part.time, getattr(part, name)) for name in names}
    values["power"] = onto(time, part.time, part.power)
    return Moves(move=np.zeros(len(time), np.int64), time=time, **values)
