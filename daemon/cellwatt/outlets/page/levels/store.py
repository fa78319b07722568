"""The page's data from one cell's recordings: level files of closed recordings, and the open recording as it grows.

Recordings are only read. A recording without a level file, for lack of disk space or budget, is read again for each
answer.
"""

from __future__ import annotations

import logging
import math
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeVar

from cellwatt.errors import CellwattError, RecordingError, why
from cellwatt.outlets.page.levels import level_file
from cellwatt.outlets.page.levels.following import Growing, Pace, Places, gather, places_in
from cellwatt.outlets.page.levels.gathering import CURVES, TELLING, Digest
from cellwatt.outlets.page.levels.level_file import LevelFile
from cellwatt.record.folder import RecordFile, files_of, remove, surplus
from cellwatt.record.header import FileName

log = logging.getLogger(__name__)

RESERVE: Final = 256e6
"""Disk space, bytes, that level files leave free for recordings."""
LATE: Final = 3600.0
"""Largest difference, s, between the clocks of a cell and of its disk."""
TICK: Final = 1.0
"""Time, s, within which two changes of a folder may have the same modification time."""
RETRY: Final = 60.0
"""Pause, s, before a failed read or write is tried again."""
PERIOD: Final = 2.0
"""Interval, s, between two checks of the folder."""
TRIES: Final = 2
"""Number of attempts to read a level file before its data count as missing."""
WORK, REST = 0.01, 0.03
"""Time, s, of reading and of the rest after it, so that the page's other threads take precedence."""

T = TypeVar("T")

Source = LevelFile | Digest
"""Levels, intervals and alarms of one recording, from ``start`` to ``end``, UTC ns."""


class _Closed(Exception):  # noqa: N818
    pass


class Store:
    """Sources of a cell's recordings in ``folder``, with level files up to ``most`` bytes; thread-safe.

    ``folder`` ``None``: the cell has no recordings. From ``start`` to ``close`` a thread updates the level files.
    """

    def __init__(self, folder: Path | None, cell: str, most: float = math.inf) -> None:
        self.folder, self.cell, self._most = folder or Path(), cell, most
        self.recorded = folder is not None
        self.counts: Counter[str] = Counter()
        """Level files unwritten, damaged and over budget; unreadable recordings."""
        self._listing: tuple[float, float, list[RecordFile]] = (0.0, 0.0, [])
        """Time of the listing, UTC s, modification time of the folder, UTC s, and its files."""
        self._files: dict[FileName, LevelFile] = {}
        self._growing: dict[FileName, Growing] = {}
        self._over: FileName | None = None
        """The newest recording whose level file was removed to stay within the budget."""
        self._again: dict[Path, float] = {}
        """Monotonic time, s, before which a failed recording or folder is not tried again."""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="levels", daemon=True)
        self._rest_at = 0.0

    def start(self) -> None:
        """Start the thread that updates the level files, if there is a folder."""
        if self.recorded:
            self._thread.start()

    def close(self) -> None:
        """Stop the thread, even in the middle of a recording."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        with suppress(OSError):  # a later write reports the error
            level_file.remove_begun(self.folder)
        while not self._closing.is_set():
            try:
                self.look(self._rest)
            except _Closed:
                return
            except (OSError, CellwattError) as error:
                log.warning("cannot read new recordings: %s", error)
            self._closing.wait(PERIOD)

    def _rest(self) -> None:
        """Rest after ``WORK`` s of work; raise ``_Closed`` when the store is closed."""
        if time.monotonic() < self._rest_at:
            return
        if self._closing.wait(REST):
            raise _Closed
        self._rest_at = time.monotonic() + WORK

    def recordings(self) -> list[RecordFile]:
        """Recordings in the folder, in order, including unreadable ones.

        Raises ``RecordingError`` if the folder cannot be read.
        """
        if not self.recorded:
            return []
        try:
            changed = self.folder.stat().st_mtime
            listed, of_change, found = self._listing
            # Two changes of a folder within one clock tick have the same modification time.
            if of_change != changed or listed - changed < TICK:
                listed, found = time.time(), files_of(self.folder, self.cell)
                self._listing = (listed, changed, found)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RecordingError(f"record.folder {self.folder} cannot be read: {why(error)}") from error
        return found

    def source(self, recording: RecordFile, pace: Pace, *, curves: bool = True) -> Source | None:
        """Source of a recording; writes its level file if missing. Without ``curves``, it may lack levels, and no level
        file is written.

        None if the recording is unreadable. Raises exceptions of ``pace``.
        """
        try:
            if not recording.closed:
                growing = self._growing.setdefault(recording.name, Growing(recording.path))
                with growing.lock:
                    growing.grow(pace)
                    return growing.gathering.digest()
            if (known := self.known(recording)) is not None or self._waits(recording.path):
                return known
            pace()
            return self._made(recording, pace) if curves else gather(recording.path, recording.size, TELLING, pace)
        except TimeoutError:
            raise
        except (OSError, RecordingError) as error:
            # A recording removed to free disk space is not an error.
            if not isinstance(error, FileNotFoundError) and not isinstance(error.__cause__, FileNotFoundError):
                self.counts["unreadable recordings"] += 1
                self._failed(recording.path, f"{recording.path} has no curves: {error}")
            return None

    def read(self, recording: RecordFile, pace: Pace, ask: Callable[[Source], T], *, curves: bool = True) -> T | None:
        """Result of ``ask`` for the source of a recording; a damaged or missing level file is written again.

        See ``source``. Raises ``TimeoutError`` if it is still damaged, as it can be neither removed nor written.
        """
        for _ in range(TRIES):
            if (source := self.source(recording, pace, curves=curves)) is None:
                return None
            try:
                return ask(source)
            except FileNotFoundError:  # removed with its recording, or to stay within the budget
                self._files.pop(recording.name, None)
            except ValueError as error:
                self.spoiled(recording, str(error))
            pace()
        raise TimeoutError

    def known(self, recording: RecordFile) -> LevelFile | None:
        """The level file of a closed recording; None if it is missing or damaged."""
        file = self._files.get(recording.name)
        if file is not None and file.size == recording.size:
            return file
        try:
            file = self._files[recording.name] = LevelFile(recording)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self.spoiled(recording, str(error))
            return None
        return file

    def spoiled(self, recording: RecordFile, reason: str) -> None:
        """Remove a damaged level file, so that it is written again."""
        self._files.pop(recording.name, None)
        self.counts["level files damaged"] += 1
        path = level_file.path_of(recording.path)
        log.warning("%s %s: it is written again", path, reason)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be removed: %s", path, why(error))

    def _made(self, recording: RecordFile, pace: Pace) -> Digest:
        """Read a closed recording, and write its level file if budget and disk space allow it."""
        digest = gather(recording.path, recording.size, CURVES | TELLING, pace)
        if self._allows(recording):
            try:
                if not self._room():
                    raise OSError("too little disk space for level files: curves of long spans are slow")
                level_file.write(recording, digest)
                self._hold()
            except (OSError, ValueError) as error:
                self.counts["level files unwritten"] += 1
                self._failed(self.folder, f"{level_file.path_of(recording.path)} cannot be written: {error}")
        return digest

    def places(self, recording: RecordFile, pace: Pace) -> Places:
        """The chunks of a recording. Raises ``OSError``, ``RecordingError``, and exceptions of ``pace``."""
        if recording.closed:
            return places_in(recording.path, recording.size)
        growing = self._growing.setdefault(recording.name, Growing(recording.path))
        with growing.lock:
            growing.grow(pace)
            return Places(growing.chunks[:], growing.tracks)

    def look(self, pace: Pace) -> None:
        """Write missing level files, newest first, and remove those of removed recordings.

        Raises ``OSError``, ``RecordingError``, and exceptions of ``pace``.
        """
        recordings = self.recordings()
        for recording in reversed(recordings) if recordings and self._room() else ():
            if recording.closed and self._allows(recording):
                self.source(recording, pace)
        present = {recording.name for recording in self.recordings()}
        remove([file for file in level_file.listing(self.folder, self.cell) if file.name not in present])
        self._hold()
        closed = {recording.name for recording in self.recordings() if recording.closed}
        for name in {*self._files} - closed:
            self._files.pop(name, None)
        for name in {*self._growing} - (present - closed):
            del self._growing[name]

    def _hold(self) -> None:
        """Remove level files of the oldest recordings until the budget is met. Raises ``OSError``."""
        files = level_file.listing(self.folder, self.cell)
        if over := surplus(files, keep=self._most, age=0, now=0, reserve=0):
            remove(over)
            self.counts["level files over budget"] += len(over)
            self._over = over[-1].name
            for file in over:
                self._files.pop(file.name, None)

    def _room(self) -> bool:
        """True if the disk has space for level files, and no write failed recently."""
        return not self._waits(self.folder) and shutil.disk_usage(self.folder).free >= RESERVE

    def _allows(self, recording: RecordFile) -> bool:
        """False for the newest recording whose level file was removed for the budget, and for older ones."""
        return self._over is None or recording.name > self._over

    def _waits(self, path: Path) -> bool:
        return time.monotonic() < self._again.get(path, 0.0)

    def _failed(self, path: Path, text: str) -> None:
        if not self._waits(path):
            log.warning("%s", text)
            self._again[path] = time.monotonic() + RETRY


def near(recordings: Iterable[RecordFile], start: int, end: int) -> list[RecordFile]:
    """Recordings that may overlap a span in UTC ns: begun before its end and written after its start."""
    late = LATE * 1e9
    return [k for k in recordings if k.name.session < end + late and (not k.closed or k.modified * 1e9 + late >= start)]


def ends_at(until: float) -> Pace:
    """A pace without rests that raises ``TimeoutError`` after monotonic time ``until``, s."""

    def pace() -> None:
        if time.monotonic() > until:
            raise TimeoutError

    return pace
