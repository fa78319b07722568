"""Brings the record into a lake, each row exactly once, whenever it is killed.

What is about to be written is on disk before it is: where that was not finished the same file is written again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from cellwatt.errors import OutletError, why
from cellwatt.files import read_bytes, replace_bytes
from cellwatt.outlets.historian.pieces import Piece, Place, Position, next_frames, next_results, parquet, root
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import Store
from cellwatt.outlets.past import ARCHIVED
from cellwatt.units import Units

FILE: Final = "historian-lake.json"


class Intent(BaseModel):
    """A file of a table that is about to be written: up to a frame, or up to a result."""

    table: str
    frame: Position | None = None
    result: Place | None = None


class Progress(BaseModel):
    """Position of each table in the lake ``lake``."""

    lake: str
    frames: Position | None = None
    results: dict[str, Place] = {}
    intent: Intent | None = None

    def save(self, folder: Path) -> None:
        """Bring it to disk, whole or not at all. Raises ``OutletError``."""
        try:
            replace_bytes(folder / FILE, self.model_dump_json().encode())
        except OSError as error:
            raise OutletError(f"lake: {folder / FILE} cannot be written: {why(error)}") from error


def load(folder: Path, lake: str) -> Progress | None:
    """The progress of that lake; ``None`` where there is none, or it is not readable. Raises ``OutletError``."""
    try:
        found = Progress.model_validate_json(read_bytes(folder / FILE))
    except (FileNotFoundError, ValidationError):
        return None
    except OSError as error:
        raise OutletError(f"lake: {folder / FILE} cannot be read: {why(error)}") from error
    return found if found.lake == lake else None


@dataclass(frozen=True, slots=True)
class Done:
    """A file that was written: ``rows`` of ``table``, and frames that the record does not have any more.

    Without rows none was written: a session had none of the channels.
    """

    table: str
    rows: int
    lost: int


class Export:
    """One run over the record in ``record`` of a cell into a ``store`` by the settings of a lake."""

    def __init__(self, record: Path, site: str, cell: str, settings: LakeSettings, store: Store) -> None:
        self._record, self._site, self._cell = record, site, cell
        self._settings, self._store = settings, store
        self._progress = load(record, settings.folder) or self._found()

    def run(self) -> Iterator[Done]:
        """Write all that is new; give each file when it is done. Raises ``OutletError``."""
        if self._progress.intent is not None:
            yield from self._again(self._progress.intent)
        yield from self._all("frames", self._frames)
        for table in ARCHIVED if self._settings.results else ():
            yield from self._all(table, partial(self._results, table))

    def _all(self, table: str, following: Callable[[], Piece | None]) -> Iterator[Done]:
        while (piece := following()) is not None:
            yield self._commit(table, piece)
            if piece.last:  # what comes meanwhile is for the next run: it would never end, in files of a few rows
                return

    def _frames(self, until: Position | None = None) -> Piece | None:
        place = self._record, self._site, self._cell
        return next_frames(*place, self._settings, self._progress.frames, until)

    def _results(self, table: str, until: Place | None = None) -> Piece | None:
        place = self._record, self._site, self._cell
        return next_results(*place, table, self._progress.results.get(table), until)

    def _commit(self, table: str, piece: Piece) -> Done:
        progress, end = self._progress, piece.end
        if piece.table is not None:
            progress.intent = (
                Intent(table=table, frame=end) if isinstance(end, Position) else Intent(table=table, result=end)
            )
            progress.save(self._record)
            self._store.put(piece.path, parquet(piece.table, self._about(table)))
        self._reach(table, end)
        return Done(table, piece.rows, piece.lost)

    def _reach(self, table: str, end: Position | Place) -> None:
        progress = self._progress
        if isinstance(end, Position):
            progress.frames = end
        else:
            progress.results[table] = end
        progress.intent = None
        progress.save(self._record)

    def _again(self, intent: Intent) -> Iterator[Done]:
        """Write the file that was begun, once more and as it was to be."""
        end: Position | Place | None = intent.frame or intent.result
        assert end is not None
        piece = self._frames(intent.frame) if intent.frame else self._results(intent.table, intent.result)
        if piece is not None and _at(piece.end) == _at(end):
            yield self._commit(intent.table, piece)
        else:  # the record has removed it meanwhile: what is there is there
            before = self._progress.frames
            self._reach(intent.table, end)
            known = self._found()
            reached = known.frames if intent.frame else known.results.get(intent.table)
            if (reached is None or _at(reached) < _at(end)) and intent.frame and before is not None:
                yield Done(intent.table, 0, max(intent.frame.sequence - before.sequence, 0))

    def _about(self, table: str) -> dict[str, Any]:
        units = {} if self._settings.units == Units() else {"units": self._settings.units.model_dump()}
        return {"site": self._site, "cell": self._cell, "table": table, **units}

    def _found(self) -> Progress:
        """Progress by the names of the files in the lake, where what is known of it is lost."""
        progress = Progress(lake=self._settings.folder)
        for table in ("frames", *ARCHIVED):
            numbers = [_numbers(name) for name in self._store.names(root(table, self._site, self._cell))]
            if table == "frames":
                last = max(((n[0], n[2]) for n in numbers if len(n) == 3), default=None)
                progress.frames = Position(*last, 0) if last is not None else None
            elif found := [Place(n[0], n[1], n[3]) for n in numbers if len(n) == 4]:
                progress.results[table] = max(found, key=_at)
        return progress


def _at(end: Position | Place) -> tuple[int, ...]:
    """The part of a position that orders it."""
    return (end.session, end.sequence) if isinstance(end, Position) else (end.session, end.number, end.count)


def _numbers(path: str) -> tuple[int, ...]:
    """Numbers in the name of a file; none where it is not ours."""
    words = path.rpartition("/")[2].removesuffix(".parquet").split("_")
    return tuple(int(word) for word in words) if all(word.isdecimal() for word in words) else ()


def as_line(done: Done) -> str:
    """A file that was written, as a line for the process that waits."""
    return json.dumps({"table": done.table, "rows": done.rows, "lost": done.lost})
