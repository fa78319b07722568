"""Training data of a power model: moves of an arm with the current of its joints and the power of its supply."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, rows_of
from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt.tables import Table, read_table, usual
from cellwatt_plugins.models.predict import starts_of
from cellwatt_plugins.robot.meter.file import power_beside, with_meters
from cellwatt_plugins.robot.meter.held import onto
from cellwatt_plugins.robot.meter.model import Meter
from cellwatt_plugins.robot.samples import interpolated

POWER = ("supply.power", "bus.power")
"""Channels of the power that a model may be trained on; the first with numbers is used."""
UNEVEN = 0.02
"""Largest relative difference between steps; rows with larger ones are interpolated to an even grid."""
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
    """(N, n) A; NaN if not measured."""
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
        """Some complete moves, renumbered."""
        kept = rows_of(self, rows)
        return replace(kept, move=np.unique(kept.move, return_inverse=True)[1].astype(np.int64))

    def only(self, moves: Iterable[int]) -> Moves:
        """The moves with these numbers, renumbered."""
        return self.where(np.isin(self.move, list(moves)))


def read_moves(paths: Sequence[Path], joints: int, meters: Sequence[Path] = ()) -> Moves:
    """Moves of one or several tables: Parquet, CSV, or recordings of cellwatt.

    A move ends where ``move`` changes, time jumps, or a position or velocity is missing. ``meters`` are the files with
    the power of the tables, in the same order. Raises ``RecordingError`` if a column is missing, or no move remains.
    """
    found = spread(_parts, with_meters(paths, meters), "reading recordings", shared=joints)
    parts = [part for of_file in found for part in of_file]
    if not parts:
        raise RecordingError(f"{paths[0]}: no {SHORTEST} rows in a row with position and velocity of all joints")
    if any(part.payload is None for part in parts):
        parts = [replace(part, payload=None) for part in parts]
    if any(part.temperature is None for part in parts):
        parts = [replace(part, temperature=None) for part in parts]
    step = float(np.median([part.step for part in parts]))
    numbered = [replace(part, move=np.full(len(part), i)) for i, part in enumerate(_even(p, step) for p in parts)]
    names = [f.name for f in fields(Moves) if getattr(numbered[0], f.name) is not None]
    whole: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in numbered]) for name in names}
    return Moves(**whole)


def _parts(file: tuple[Path, Path | None], joints: int) -> list[Moves]:
    """The moves of a file and its meter's file, each numbered 0."""
    path, meter = file
    table = read_table(path)
    time = table.time
    metered = None if meter is None else power_beside(meter, table.rising_time(), table.needed("position", joints))
    found = _quantities(table, joints, metered)
    starts = starts_of(table)
    whole = np.isfinite(np.column_stack([found["q"], found["qd"]])).all(axis=1)
    starts |= np.diff(whole, prepend=False)
    group = np.cumsum(starts)
    out = []
    for number in np.unique(group[whole]):
        rows = whole & (group == number)
        if np.sum(rows) >= SHORTEST:
            kept = {name: value[rows] for name, value in found.items()}
            out.append(Moves(move=np.zeros(np.sum(rows), np.int64), time=time[rows], **kept))
    return out


def _quantities(table: Table, joints: int, metered: Float | None) -> dict[str, Float]:
    """The fields of ``Moves``, other than the time, that a file has."""
    missing = np.full(len(table), np.nan)
    current = _each(table, "current", joints)
    known = [metered] if metered is not None else [table.whole(name) for name in POWER]
    power = next((each for each in known if each is not None and np.isfinite(each).any()), None)
    if current is None and power is None:
        raise table.lacks(f"power, nor of {usual('current', 1)} …, that holds numbers")
    optional = {"payload": table.whole("tool.payload"), "temperature": _each(table, "temperature", joints)}
    return {
        "q": table.needed("position", joints),
        "qd": table.needed("velocity", joints),
        "current": np.column_stack([missing] * joints) if current is None else current,
        "power": missing if power is None else power,
        **{name: value for name, value in optional.items() if value is not None},
    }


def _each(table: Table, quantity: str, joints: int) -> Float | None:
    """A quantity of the first joints, (N, joints); None if the file lacks it, or its numbers, at one of these."""
    found = table.joints(quantity)
    if found is None or found.shape[1] < joints:
        return None
    whole = np.isfinite(found[:, :joints]).any(axis=0).all()
    return found[:, :joints] if whole else None


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
