"""Makes the next file of a lake's table from the record, as Parquet. The same record gives the same file.

pyarrow is imported here: only the process that writes a lake needs it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain, groupby, islice, takewhile
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from cellwatt.frames import Frames, cut
from cellwatt.outlets.past import ARCHIVED, Archived, opened
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.outlets.zenoh.messages import encode_json
from cellwatt.record.folder import RecordFile, files_of
from cellwatt.record.messages import time_of
from cellwatt.record.overlap import reach
from cellwatt.record.reader import EVER
from cellwatt.results import Alarm, Energy, Task
from cellwatt.version import __version__

T = TypeVar("T", Alarm, Task, Energy)


@dataclass(frozen=True, slots=True, order=True)
class Reached:
    """The last exported frame or result of a session.

    For a frame, ``number`` is its sequence and ``time`` its time, UTC ns, if known; for a result, ``number`` is that of
    its file in the session, and ``count`` the number of exported results of this file. Everything in files of the
    session up to number ``complete`` is exported.
    """

    session: int
    number: int
    count: int = 0
    time: int = field(default=0, compare=False)
    complete: int = field(default=-1, compare=False)


Positions = Mapping[int, Reached]
"""The position in each session of which anything was exported. If the PC's clock was set back between two sessions,
the later one has the earlier start."""


def sessions(folder: Path, cell: str) -> list[list[RecordFile]]:
    """The recordings of each session, the running session last, also if the PC's clock was set back before it."""
    found = [list(files) for _, files in groupby(files_of(folder, cell), lambda file: file.name.session)]
    return sorted(found, key=lambda files: (not closed(files), max(file.modified for file in files)))


def closed(files: Sequence[RecordFile]) -> bool:
    """True if no file of a session is being written."""
    return all(file.closed for file in files)


def _incomplete(
    folder: Path, cell: str, positions: Positions
) -> Iterator[tuple[list[RecordFile], Reached | None, Reached | None]]:
    """Of each session: the files that are not known to be exported, its position, and the position after its end.

    The latter is ``None`` while the session may still grow.
    """
    found = sessions(folder, cell)
    for files in found:
        session, last = files[0].name.session, files[-1].name.number
        after = positions.get(session)
        complete = -1 if after is None else after.complete
        if last > complete:
            ended = files is not found[-1] and closed(files)
            end = Reached(session, -1, complete=last) if ended else None
            yield [file for file in files if file.name.number > complete], after, end


def _passed(time: int, file: RecordFile) -> bool:
    """True if a file is closed and holds nothing after a time, UTC ns."""
    return file.closed and 0 < reach(file)[1] <= time


def frames_after(folder: Path, cell: str, positions: Positions) -> Iterator[tuple[int, Frames | Reached]]:
    """Blocks of frames after the position in their session, each with its session; the end of each ended session.

    Before these, the position with the files that it leaves behind, so that later searches do not open them.
    """
    for files, after, end in _incomplete(folder, cell, positions):
        session = files[0].name.session
        if after is not None:
            passed = list(takewhile(partial(_passed, after.time), files))
            if passed and end is None:
                yield session, replace(after, complete=passed[-1].name.number)
            del files[: len(passed)]
        for recording in map(opened, (file.path for file in files)):
            if recording is None or (after is not None and recording.end <= after.time):
                continue
            for block in (recording if after is None else recording.between(after.time + 1, EVER)).frames():
                known = 0 if after is None else after.number + 1 - block.sequence
                if known < len(block):
                    yield session, cut(block, known, len(block))
        if end is not None:
            yield session, end


def results_after(folder: Path, cell: str, kind: type[T], positions: Positions) -> Iterator[tuple[Reached, T | None]]:
    """Results of a kind after the position in their session, each with its own position.

    With ``None``: the end of a session, or the last file that was searched.
    """
    for files, after, end in _incomplete(folder, cell, positions):
        unread = False
        for file in files:
            if after is not None and file.name.number < after.number:
                continue
            recording = opened(file.path)
            unread |= recording is None and file is not files[-1]
            known = after.count if after is not None and file.name.number == after.number else 0
            for number, result in enumerate(recording.results(kind) if recording is not None else (), 1):
                if number > known:
                    yield Reached(file.name.session, file.name.number, number), result
        if end is not None:
            yield end, None
        elif not unread and (after is None or after.number < files[-1].name.number):
            yield Reached(files[-1].name.session, files[-1].name.number), None


VALUES: Final = 1_000_000
"""Most values of a file: its rows take about 100 MB of memory."""
RESULTS: Final = 50_000
"""Most results of a file."""
_DAY: Final = 86_400 * 10**9  # ns


@dataclass(frozen=True, slots=True)
class Piece:
    """A file to write: its path in the lake and its table, ``None`` if there is nothing to write.

    ``end`` is the position after it, ``lost`` the number of frames up to there that the record lacks. ``last``: it
    contains everything recorded by now.
    """

    path: str
    rows: int
    table: Any
    end: Reached
    lost: int = 0
    last: bool = False


def root(table: str, site: str, cell: str) -> str:
    """Folder of a cell's files in a table."""
    return f"{table}/site={quote(site, safe='')}/cell={quote(cell, safe='')}"


def day_of(time: int) -> str:
    """UTC date of a time in UTC ns."""
    return datetime.fromtimestamp(time // 10**9, UTC).strftime("%Y-%m-%d")


def next_frames(
    folder: Path, site: str, cell: str, selection: Selection, positions: Positions
) -> Piece | Reached | None:
    """The next file of frames, of one session, layout and day; ``None`` if no row is complete yet.

    A position alone says that a session has no frames beyond those exported.
    """
    blocks = frames_after(folder, cell, positions)
    session, first = next(blocks, (0, None))
    if first is None or isinstance(first, Reached):
        return first
    picker, rows, over = Picker(selection, first.layout), list[Row](), False
    most = max(1, VALUES // (len(picker.units) + 4))
    seen = positions.get(session, Reached(session, first.sequence - 1))
    gaps: list[tuple[int, int]] = []
    for at, block in chain([(session, first)], blocks):
        if isinstance(block, Reached) or at != session or block.layout != picker.layout:
            over = True
            rows += picker.rest()
            seen = replace(seen, complete=block.complete) if isinstance(block, Reached) and at == session else seen
            break
        gaps.append((block.sequence, block.sequence - seen.number - 1))
        seen = Reached(session, block.sequence + len(block) - 1, time=int(block.time[-1]))
        rows += picker.rows(block)
        if len(rows) > most or (rows and rows[-1].time // _DAY > rows[0].time // _DAY):
            break
    if not rows:  # the layout has none of the channels, or no row is complete yet
        return Piece("", 0, None, seen) if over or not picker.units else None
    chosen = [row for row in rows[:most] if row.time // _DAY == rows[0].time // _DAY]
    last, full = chosen[-1], len(chosen) < len(rows)
    # After a session or layout has ended, all its frames count as exported, also those after the last row.
    end = seen if over and not full else Reached(session, last.sequence, time=min(last.time, seen.time))
    name = f"{session}_{first.sequence}_{last.sequence}.parquet"
    path = f"{root('frames', site, cell)}/day={day_of(last.time)}/{name}"
    lost = sum(n for at, n in gaps if at <= end.number)
    return Piece(path, len(chosen), frame_table(chosen, picker.units, session), end, lost, last=not (over or full))


def next_results(folder: Path, site: str, cell: str, table: str, positions: Positions) -> Piece | Reached | None:
    """The next file of alarms, tasks or energies, of one file of the record and one day.

    A position alone says that a session has no results beyond those exported.
    """
    found = results_after(folder, cell, ARCHIVED[table], positions)
    first, result = next(found, (None, None))
    if first is None or result is None:
        return first
    day, chosen, last = time_of(result) // _DAY, [result], first
    for at, later in islice(found, RESULTS - 1):
        if later is None or (at.session, at.number, time_of(later) // _DAY) != (first.session, first.number, day):
            break
        chosen.append(later)
        last = at
    name = f"{first.session}_{first.number}_{first.count}_{last.count}.parquet"
    path = f"{root(table, site, cell)}/day={day_of(time_of(result))}/{name}"
    return Piece(path, len(chosen), result_table(table, chosen, first.session), last)


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
"""Fields of results whose columns have another name."""


def frame_table(rows: Sequence[Row], units: Mapping[str, str], session: int) -> pa.Table:
    """Rows as columns ``time``, ``session``, ``sequence``, ``quality`` and one per channel; missing values are null.

    ``quality`` is the worst of the values present.
    """
    columns: dict[str, Any] = {
        "time": pa.array([row.time for row in rows], _TIME),
        "session": pa.array([session] * len(rows), pa.int64()),
        "sequence": pa.array([row.sequence for row in rows], pa.int64()),
        "quality": pa.array([row.worst for row in rows], pa.uint8()),
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
    """A table as a Parquet file, with ``about`` in its metadata under ``cellwatt``."""
    metadata = json.dumps({**about, "version": __version__})
    out = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"cellwatt": metadata}), out, compression="zstd")
    content: bytes = out.getvalue().to_pybytes()
    return content


def _cell(table: str, column: str, result: Archived) -> Any:
    value = getattr(result, _FIELDS.get((table, column), column))
    if column == "evidence":
        return encode_json(dict(value)).decode()
    return list(value.items()) if column == "groups" else value
