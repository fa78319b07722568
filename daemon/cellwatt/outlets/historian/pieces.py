"""The next file of a table of a lake, made of the record, and its Parquet. The same record gives the same file again.

pyarrow is imported here: only the process that writes a lake needs it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq
import pydantic_core

from cellwatt.channel import Quality
from cellwatt.frames import Frames, cut
from cellwatt.outlets.past import ARCHIVED, Archived, files_of, opened
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.record.messages import time_of
from cellwatt.record.reader import EVER
from cellwatt.results import Alarm, Energy, Task
from cellwatt.version import __version__

T = TypeVar("T", Alarm, Task, Energy)


@dataclass(frozen=True, slots=True, order=True)
class Reached:
    """The last frame or result that was dealt with.

    Of a frame ``number`` is its sequence, and ``time`` its time, UTC ns, if it is known; of a result ``number`` is that
    of its file in the session, and ``count`` how many of the file are dealt with.
    """

    session: int
    number: int
    count: int = 0
    time: int = field(default=0, compare=False)


def frames_after(folder: Path, cell: str, position: Reached | None) -> Iterator[tuple[int, Frames]]:
    """Blocks of frames after ``position``, each with its session; all there are without one."""
    for kept in files_of(folder, cell):
        session = kept.name.session
        after = position if position is not None and session == position.session else None
        if position is not None and session < position.session:
            continue
        recording = opened(kept.path)
        if recording is None or (after is not None and recording.end <= after.time):
            continue
        for block in (recording if after is None else recording.between(after.time + 1, EVER)).frames():
            known = 0 if after is None else after.number + 1 - block.sequence
            if known < len(block):
                yield session, cut(block, known, len(block))


def results_after(folder: Path, cell: str, kind: type[T], reached: Reached | None) -> Iterator[tuple[Reached, T]]:
    """Results of a kind after ``reached``, each with how far it leads."""
    for kept in files_of(folder, cell):
        at = kept.name.session, kept.name.number
        if reached is not None and at < (reached.session, reached.number):
            continue
        recording = opened(kept.path)
        known = reached.count if reached is not None and at == (reached.session, reached.number) else 0
        for number, result in enumerate(recording.results(kind) if recording is not None else (), 1):
            if number > known:
                yield Reached(*at, number), result


VALUES: Final = 4_000_000
"""Values of a file at most."""
RESULTS: Final = 50_000
"""Results of a file at most."""
_DAY: Final = 86_400 * 10**9  # ns


@dataclass(frozen=True, slots=True)
class Piece:
    """A file to be: its path in the lake and its table, ``None`` where nothing is to be written.

    ``end`` is the position that it leads to, ``lost`` the frames up to there that the record does not have. ``last``:
    it has all that was recorded by now.
    """

    path: str
    rows: int
    table: Any
    end: Reached
    lost: int = 0
    last: bool = False


def root(table: str, site: str, cell: str) -> str:
    """Folder of a cell in a table."""
    return f"{table}/site={quote(site, safe='')}/cell={quote(cell, safe='')}"


def day_of(time: int) -> str:
    """Day of a time, UTC ns."""
    return datetime.fromtimestamp(time // 10**9, UTC).strftime("%Y-%m-%d")


class _Rows:
    """Rows of one file: of one session, one layout and one day."""

    def __init__(self, selection: Selection, session: int, first: Frames, until: Reached | None) -> None:
        self.picker = Picker(selection, first.layout)
        self.session, self.first = session, first.sequence
        self.rows: list[Row] = []
        self.full = False
        self.seen = Reached(session, first.sequence - 1)
        self._gaps: list[tuple[int, int]] = []
        self._until = until.number if until is not None else None
        self._most = max(1, VALUES // (len(self.picker.units) + 4))

    def fits(self, session: int, block: Frames) -> bool:
        layout = self.picker.layout
        return session == self.session and (block.layout is layout or block.layout == layout)

    def add(self, block: Frames) -> None:
        if block.sequence > self.seen.number + 1:
            self._gaps.append((block.sequence, block.sequence - self.seen.number - 1))
        self.seen = Reached(self.session, block.sequence + len(block) - 1, time=int(block.time[-1]))
        self.take(list(self.picker.rows(block)))

    def take(self, rows: list[Row]) -> None:
        for row in rows:
            beyond = self._until is not None and row.sequence > self._until
            other_day = bool(self.rows) and row.time // _DAY != self.rows[0].time // _DAY
            self.full = self.full or beyond or other_day or len(self.rows) >= self._most
            if self.full:
                return
            self.rows.append(row)

    def lost(self, end: Reached, before: Reached | None) -> int:
        ahead = self.first - before.number - 1 if before is not None and before.session == self.session else 0
        return ahead + sum(n for at, n in self._gaps if at <= end.number)


def next_frames(
    folder: Path, site: str, cell: str, selection: Selection, after: Reached | None, until: Reached | None = None
) -> Piece | None:
    """The next file of frames; up to ``until`` where that was begun before. ``None`` where no row is whole yet."""
    rows: _Rows | None = None
    over = False
    for session, block in frames_after(folder, cell, after):
        if rows is None:
            rows = _Rows(selection, session, block, until)
        if over := not rows.fits(session, block):
            break
        rows.add(block)
        if rows.full:
            break
    if rows is None:
        return None
    if over and not rows.full:
        rows.take(list(rows.picker.rest()))
    if not rows.rows and not over:
        return None
    return _framed(rows, site, cell, after, over)


def _framed(rows: _Rows, site: str, cell: str, after: Reached | None, over: bool) -> Piece:
    if not rows.rows:  # none of its channels is asked for
        return Piece("", 0, None, rows.seen, 0)
    last = rows.rows[-1]
    # All frames of a session or layout that is over are dealt with, also those behind the last row.
    end = (
        rows.seen
        if over and not rows.full
        else Reached(rows.session, last.sequence, time=min(last.time, rows.seen.time))
    )
    table = frame_table(rows.rows, rows.picker.units, rows.session)
    name = f"{rows.session}_{rows.first}_{last.sequence}.parquet"
    path = f"{root('frames', site, cell)}/day={day_of(last.time)}/{name}"
    return Piece(path, len(rows.rows), table, end, rows.lost(end, after), last=not (over or rows.full))


def next_results(
    folder: Path, site: str, cell: str, table: str, after: Reached | None, until: Reached | None = None
) -> Piece | None:
    """The next file of alarms, tasks or energies; up to ``until`` where that was begun before."""
    kept = list(_alike(results_after(folder, cell, ARCHIVED[table], after), until))
    if not kept:
        return None
    (first, result), (last, _) = kept[0], kept[-1]
    name = f"{first.session}_{first.number}_{first.count}_{last.count}.parquet"
    path = f"{root(table, site, cell)}/day={day_of(time_of(result))}/{name}"
    return Piece(path, len(kept), result_table(table, [r for _, r in kept], first.session), last)


def _alike(found: Iterator[tuple[Reached, Archived]], until: Reached | None) -> Iterator[tuple[Reached, Archived]]:
    """The first of the results that are of one file of the record and one day."""
    kept: tuple[int, int, int] | None = None
    for n, (reached, result) in enumerate(found):
        about = reached.session, reached.number, time_of(result) // _DAY
        kept = kept or about
        if about != kept or n >= RESULTS or (until is not None and reached.count > until.count):
            return
        yield reached, result


_TIME: Final = pa.timestamp("ns", tz="UTC")
_SCHEMAS: Final = {
    "alarms": (
        ("time", _TIME), ("session", pa.int64()), ("id", pa.string()), ("kind", pa.string()),
        ("severity", pa.string()), ("active", pa.bool_()), ("since", _TIME), ("statement", pa.string()),
        ("source", pa.string()), ("joint", pa.int64()), ("stage", pa.string()), ("evidence", pa.string()),
    ),
    "tasks": (
        ("time", _TIME), ("session", pa.int64()), ("start", _TIME), ("source", pa.string()), ("task", pa.string()),
        ("signature", pa.string()), ("variant", pa.string()), ("speed", pa.float64()), ("repetition", pa.int64()),
    ),
    "energies": (
        ("time", _TIME), ("session", pa.int64()), ("start", _TIME), ("source", pa.string()), ("task", pa.string()),
        ("variant", pa.string()), ("repetition", pa.int64()), ("total", pa.float64()),
        ("uncertainty", pa.float64()), ("positive_mechanical", pa.float64()),
        ("motion_efficiency_percent", pa.float64()), ("groups", pa.map_(pa.string(), pa.float64())),
    ),
}  # fmt: skip
_FIELDS: Final = {("tasks", "time"): "end", ("tasks", "task"): "name", ("energies", "time"): "end"}
"""Fields of results whose columns are called otherwise."""


def frame_table(rows: Sequence[Row], units: Mapping[str, str], session: int) -> pa.Table:
    """Rows as columns ``time``, ``session``, ``sequence``, ``quality`` and one a channel; missing values are null.

    ``quality`` is the worst of the values that are there.
    """
    columns: dict[str, Any] = {
        "time": pa.array([row.time for row in rows], _TIME),
        "session": pa.array([session] * len(rows), pa.int64()),
        "sequence": pa.array([row.sequence for row in rows], pa.int64()),
        "quality": pa.array([_worst(row) for row in rows], pa.uint8()),
    }
    fields = [pa.field(name, array.type) for name, array in columns.items()]
    for name, unit in units.items():
        columns[name] = pa.array([row.values.get(name) for row in rows], pa.float64())
        fields.append(pa.field(name, pa.float64(), metadata={"unit": unit}))
    return pa.table(list(columns.values()), schema=pa.schema(fields))


def result_table(name: str, results: Sequence[Archived], session: int) -> pa.Table:
    """Results of one kind as the table ``name``: alarms, tasks or energies."""
    columns = [column for column, _ in _SCHEMAS[name] if column != "session"]
    plain = [{"session": session, **{c: _cell(name, c, result) for c in columns}} for result in results]
    schema = pa.schema([pa.field(column, kind) for column, kind in _SCHEMAS[name]])
    return pa.Table.from_pylist(plain, schema=schema)


def parquet(table: pa.Table, about: Mapping[str, Any]) -> bytes:
    """A table as a Parquet file; ``about`` is put into its metadata under ``cellwatt``."""
    told = json.dumps({**about, "version": __version__})
    out = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"cellwatt": told}), out, compression="zstd")
    content: bytes = out.getvalue().to_pybytes()
    return content


def _worst(row: Row) -> int:
    there = (quality for name, quality in row.quality.items() if name in row.values)
    return max(there, default=int(Quality.MISSING))


def _cell(table: str, column: str, result: Archived) -> Any:
    value = getattr(result, _FIELDS.get((table, column), column))
    if column == "evidence":
        return pydantic_core.to_json(dict(value), inf_nan_mode="null", fallback=str).decode()
    return list(value.items()) if column == "groups" else value
