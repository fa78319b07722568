"""What a power model is trained on: moves of an arm with the current of its joints and the power of its supply."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.predict import starts_of
from cellwatt_plugins.models.tables import channel_of, read_table
from cellwatt_plugins.robot.meter import Meter, onto, power_beside, with_meters

Float = NDArray[np.float64]

POWER = ("supply.power", "bus.power")
"""Channels that a model of the supply power may be trained on; the first that is there counts."""
UNEVEN = 0.02
"""Steps that differ by more than this share are put on an even grid."""
SHORTEST = 10
"""Rows that a move must have to count."""


@dataclass(frozen=True)
class Moves:
    """N rows of n joints; rows of one move follow each other at an even step."""

    move: NDArray[np.int64]
    """(N,) which move, rising from 0."""
    time: Float
    """(N,) s."""
    q: Float
    """(N, n) rad."""
    qd: Float
    """(N, n) rad/s."""
    current: Float
    """(N, n) A; NaN where it was not measured."""
    power: Float
    """(N,) W; NaN where it was not measured."""
    payload: Float | None = None
    """(N,) kg at the flange, where it was recorded."""
    temperature: Float | None = None
    """(N, n) °C of the joints, where it was recorded."""
    came: Float | None = None
    """(N,) s when a row's power came, of a slow meter; NaN in rows that repeat a value."""
    meter: Meter | None = None
    """The slow meter that power is from."""

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
        """Some whole moves, numbered anew."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        kept: dict[str, Any] = {name: value[rows] for name, value in values.items() if isinstance(value, np.ndarray)}
        kept["move"] = np.unique(kept["move"], return_inverse=True)[1].astype(np.int64)
        return replace(self, **kept)

    def only(self, moves: Iterable[int]) -> Moves:
        """Some moves."""
        return self.where(np.isin(self.move, list(moves)))


def read_moves(paths: Sequence[Path], joints: int, meters: Sequence[Path] = ()) -> Moves:
    """Moves of one or several tables: Parquet, CSV, or recordings of cellwatt.

    A move ends where ``move`` changes, time jumps, or a position or velocity is missing. ``meters`` logged the power
    of the tables in the same place. Raises ``RecordingError`` where a column is missing, or nothing is left.
    """
    parts = [part for path, meter in with_meters(paths, meters) for part in _parts(path, joints, meter)]
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


def _parts(path: Path, joints: int, meter: Path | None) -> list[Moves]:
    """The moves of one file, each numbered 0."""
    table = read_table(path)
    columns = {name: column for name in table.column_names if (column := _numbers(table[name])) is not None}
    if "t" not in columns:
        raise RecordingError(f"{path}: no column t for the time; there are: {', '.join(list(columns)[:12])}")
    if meter is not None:
        columns["power"] = _metered(columns, joints, path, meter)
    found = _quantities(columns, joints, path)
    starts = starts_of(columns)
    whole = np.isfinite(np.column_stack([found["q"], found["qd"]])).all(axis=1)
    starts |= np.diff(whole, prepend=False)
    group = np.cumsum(starts)
    out = []
    for number in np.unique(group[whole]):
        rows = whole & (group == number)
        if np.sum(rows) >= SHORTEST:
            kept = {name: value[rows] for name, value in found.items()}
            out.append(Moves(move=np.zeros(np.sum(rows), np.int64), time=columns["t"][rows], **kept))
    return out


def _metered(columns: Mapping[str, Float], joints: int, path: Path, meter: Path) -> Float:
    """Power (N,) W from a meter's own file."""
    positions = [channel_of(f"joint_{i + 1}.position", columns, path) for i in range(joints)]
    there = [column for column in positions if column is not None]
    if len(there) < joints or np.any(np.diff(columns["t"]) <= 0):
        raise RecordingError(
            f"{path}: with --meter it needs the positions of all joints, and one time that rises through all moves"
        )
    return power_beside(meter, columns["t"], np.column_stack(there))


def _quantities(columns: Mapping[str, Float], joints: int, path: Path) -> dict[str, Float]:
    """The fields of ``Moves`` that a file has, beside the time."""
    missing = np.full(len(columns["t"]), np.nan)

    def each(quantity: str) -> Float | None:
        found = [channel_of(f"joint_{i + 1}.{quantity}", columns, path) for i in range(joints)]
        there = [column for column in found if column is not None]
        return np.column_stack(there) if len(there) == joints else None

    q, qd, current = each("position"), each("velocity"), each("current")
    power = next((found for name in POWER if (found := channel_of(name, columns, path)) is not None), None)
    lacking = [name for name, found in (("q", q), ("qd", qd)) if found is None]
    if q is None or qd is None or (current is None and power is None):
        wanted = " and ".join(f"{name}_1 … {name}_{joints}" for name in lacking) or "power, nor of current_1 …"
        raise RecordingError(f"{path}: no column of {wanted}; there are: {', '.join(list(columns)[:12])}")
    optional = {"payload": channel_of("tool.payload", columns, path), "temperature": each("temperature")}
    return {
        "q": q,
        "qd": qd,
        "current": np.column_stack([missing] * joints) if current is None else current,
        "power": missing if power is None else power,
        **{name: value for name, value in optional.items() if value is not None},
    }


def _even(part: Moves, step: float) -> Moves:
    """The same on an even grid of ``step`` s; as it is where its steps are even."""
    steps = np.diff(part.time)
    if np.abs(steps / step - 1).max(initial=0.0) < UNEVEN:
        return part
    time = np.arange(part.time[0], part.time[-1] + 1e-9, step)

    def interpolated(values: Float) -> Float:
        flat = values.reshape(len(values), -1)
        columns = [np.interp(time, part.time, column) for column in flat.T]
        return np.column_stack(columns).reshape(len(time), *values.shape[1:])

    names = [f.name for f in fields(Moves) if f.name not in ("move", "time") and getattr(part, f.name) is not None]
    values: dict[str, Any] = {name: interpolated(getattr(part, name)) for name in names}
    values["power"] = onto(time, part.time, part.power)
    return Moves(move=np.zeros(len(time), np.int64), time=time, **values)


def _numbers(column: pa.ChunkedArray) -> Float | None:
    """A column as float64, missing values NaN; None where it holds no numbers."""
    if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        return None
    return np.asarray(column.cast(pa.float64()).to_numpy(), np.float64)
