"""The process that exports the record to a lake, each row exactly once: ``python -m`` this module, orders on stdin.

A separate process, because Parquet and S3 block, and its memory is free again when it ends. The intent to write a
file is on disk before the file: after an unfinished write, the file names in the lake give the position reached.
"""

from __future__ import annotations

import fcntl
import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel, ConfigDict

from cellwatt.errors import CellwattError, OutletError, why
from cellwatt.files import read_saved, replace_bytes
from cellwatt.outlets.historian.pieces import Piece, Reached, next_frames, next_results, parquet, root
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import Store, s3_options
from cellwatt.outlets.past import ARCHIVED
from cellwatt.record.folder import files_of
from cellwatt.units import Units

FILE: Final = "historian-lake.json"
SESSIONS: Final = 2000
"""Number of sessions, in a table, beyond which the positions of those without a file in the record are forgotten."""


class Progress(BaseModel):
    """Positions in each table of the lake ``lake``; with an ``intent``, a table may have one file beyond them."""

    model_config = ConfigDict(extra="forbid")

    lake: str
    reached: dict[str, dict[int, Reached]] = {}
    intent: Any = None

    def save(self, folder: Path) -> None:
        """Write the progress to disk atomically. Raises ``OutletError``."""
        try:
            replace_bytes(folder / FILE, self.model_dump_json().encode())
        except OSError as error:
            raise OutletError(f"lake: {folder / FILE} cannot be written: {why(error)}") from error


@dataclass(frozen=True, slots=True)
class Done:
    """A written file: ``rows`` of ``table``, and ``lost``, the number of frames no longer in the record.

    Without rows no file was written: a session had none of the channels.
    """

    table: str
    rows: int
    lost: int


class Export:
    """One export of a cell's record, in the folder ``record``, to ``store``."""

    def __init__(self, record: Path, site: str, cell: str, settings: LakeSettings, store: Store) -> None:
        self._record, self._site, self._cell = record, site, cell
        self._settings, self._store = settings, store
        known = read_saved(record / FILE, Progress.model_validate_json, "the names in the lake tell the positions")
        if known is None or known.lake != settings.folder:
            known = Progress(lake=settings.folder, intent=True)
        self._progress = known
        if self._progress.intent:
            self._look()

    def run(self) -> Iterator[Done]:
        """Write all new rows and results; yield each file once it is written. Raises ``OutletError``."""
        for table in ("frames", *(ARCHIVED if self._settings.results else ())):
            while (piece := self._next(table)) is not None:
                if isinstance(piece, Reached):
                    self._note(table, piece)
                    self._progress.save(self._record)
                    continue
                yield self._commit(table, piece)
                if piece.last:  # newer rows are for the next run, else this one would go on in files of a few rows
                    break

    def _next(self, table: str) -> Piece | Reached | None:
        cell, positions = (self._record, self._site, self._cell), self._progress.reached.get(table, {})
        if table == "frames":
            return next_frames(*cell, self._settings, positions)
        return next_results(*cell, table, positions)

    def _commit(self, table: str, piece: Piece) -> Done:
        if piece.table is not None:
            self._progress.intent = True
            self._progress.save(self._record)
            self._store.put(piece.path, parquet(piece.table, self._about(table)))
        self._note(table, piece.end)
        self._progress.intent = None
        self._progress.save(self._record)
        return Done(table, piece.rows, piece.lost)

    def _about(self, table: str) -> dict[str, Any]:
        units = {} if self._settings.units == Units() else {"units": self._settings.units.model_dump()}
        return {"site": self._site, "cell": self._cell, "table": table, **units}

    def _look(self) -> None:
        """Continue after the files in the lake, according to their names."""
        for table in ("frames", *ARCHIVED):
            for reached in map(_reached, self._store.names(root(table, self._site, self._cell))):
                if reached is not None:
                    self._note(table, reached)

    def _note(self, table: str, reached: Reached) -> None:
        """Set the position in a session, unless a later one is known."""
        positions = self._progress.reached.setdefault(table, {})
        known = positions.get(reached.session, reached)
        complete = max(reached.complete, known.complete)
        positions[reached.session] = replace(max(reached, known), complete=complete)
        if len(positions) > SESSIONS:
            recorded = {file.name.session for file in files_of(self._record, self._cell)} | {reached.session}
            self._progress.reached[table] = {session: at for session, at in positions.items() if session in recorded}


def _reached(path: str) -> Reached | None:
    """Position that the file of that name reaches; ``None`` if it is not a file of this exporter."""
    words = path.rpartition("/")[2].removesuffix(".parquet").split("_")
    match [int(word) for word in words if word.isdecimal()]:
        case [session, _, last] if len(words) == 3:
            return Reached(session, last)
        case [session, number, _, last] if len(words) == 4:
            return Reached(session, number, last)
    return None


LOCK: Final = "historian-lake.lock"
"""File in the folder of the record that is locked while a lake is written."""


def store_of(settings: LakeSettings, folder: Path) -> Store:
    """The store of a lake; a relative folder is relative to ``folder``."""
    if not settings.remote:
        return Store(folder / settings.folder)
    keys = None
    if settings.access_key is not None and settings.secret_key is not None:
        keys = settings.access_key.get_secret_value(), settings.secret_key.get_secret_value()
    ca = None if settings.ca is None else str(folder / settings.ca)
    return Store(settings.folder, s3_options(settings.endpoint, settings.region, keys, ca))


def work(order: dict[str, Any]) -> None:
    """Export once, as the outlet orders. Raises ``OutletError``, also if another process is exporting."""
    settings, record = LakeSettings.model_validate(order["settings"]), Path(order["record"])
    store = store_of(settings, Path(order["folder"]))
    with _alone(record / LOCK):
        for done in Export(record, order["site"], order["cell"], settings, store).run():
            print(json.dumps(asdict(done)), file=sys.stderr, flush=True)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    try:
        file = path.open("ab")
    except OSError as error:  # the folder was removed, or is no longer writable
        raise OutletError(f"lake: {path} cannot be opened: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutletError("lake: another process still writes it") from None
        yield


def main() -> int:
    """Export; return the exit code."""
    logging.disable(logging.WARNING)  # hides warnings about the file that is still being written
    try:
        work(json.load(sys.stdin))
    except CellwattError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
