"""Level files of one cell's recordings, made for closed ones, and the open recording as far as anybody asks for it.

Recordings are only read. Where the disk has no room for a level file, what it would hold stays in memory as far as that
goes, and the rest is read from the recordings again.
"""

from __future__ import annotations

import logging
import math
import shutil
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import RecordingError, why
from cellwatt.outlets.page.levels import level_file
from cellwatt.outlets.page.levels.following import EVERYTHING, Growing, Held, Pace, Places, Source, gather
from cellwatt.outlets.page.levels.gathering import TELLING, Gathering
from cellwatt.outlets.page.levels.level_file import Budget, LevelFile
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.folder import RecordFile, listing
from cellwatt.record.header import FileName
from cellwatt.record.survey import ATTEMPTS, survey

log = logging.getLogger(__name__)

HELD: Final = 32e6
"""Bytes of memory for recordings whose level file could not be written."""
RESERVE: Final = 256e6
"""Bytes of the disk that level files leave free: what is left belongs to the record."""
LATE: Final = 3600.0
"""s by which the clocks of a cell and of its disk may differ."""
TICK: Final = 1.0
"""s within which two changes of a folder may have the same time."""
CHUNKS: Final = 3
"""Closed recordings whose list of chunks is kept in memory."""
LISTED: Final = 60.0
"""s for which a listing of the folder holds while the folder is not changed."""
RETRY: Final = 60.0
"""Pause, s, before what failed is tried again."""


class Store:
    """Sources of a cell's recordings in ``folder``, with level files up to ``most`` bytes. Any thread may ask."""

    def __init__(self, folder: Path, cell: str, most: float = math.inf) -> None:
        self.folder = folder
        self.budget = Budget(folder, cell, most)
        self.counts: Counter[str] = Counter()
        """Level files made, unwritten, damaged, removed and over the budget; recordings that could not be read."""
        self.problem = ""
        self._cell = cell
        self._lock = threading.Lock()
        self._building, self._surveying = threading.Lock(), threading.Lock()
        self._sources: dict[Path, tuple[int, Source]] = {}
        self._growing: dict[Path, Growing] = {}
        self._listing: tuple[float, float, list[RecordFile]] = (0.0, 0.0, [])
        """UTC s at which the folder was listed, its last change then, and what was in it."""
        self._held: OrderedDict[Path, Held] = OrderedDict()
        self._chunks: OrderedDict[Path, tuple[int, Places, Mapping[int, Track]]] = OrderedDict()
        self._again: dict[Path, float] = {}
        """Monotonic time, s, before which a recording that could not be read, or the disk, is not tried again."""

    def recordings(self) -> list[RecordFile]:
        """Recordings that are there, in order; those of which nothing can be read are among them.

        Raises ``RecordingError`` where the folder cannot be read.
        """
        try:
            changed = self.folder.stat().st_mtime
            listed, of_change, found = self._listing
            # A folder that is changed twice within one tick of the clock has the same time both times.
            if of_change != changed or listed - changed < TICK or time.time() - listed > LISTED:
                listed, found = time.time(), self._settled()
                self._listing = (listed, changed, found)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RecordingError(f"record.folder {self.folder} cannot be read: {why(error)}") from error
        return [kept for kept in found if not kept.closed or kept.path.suffix == ".mcap"]

    def _settled(self) -> list[RecordFile]:
        """A listing that no rename has disturbed, as far as that can be had: a file is missing in one of them."""
        before: list[Path] | None = None
        for _ in range(ATTEMPTS):
            found = listing(self.folder, self._cell)
            names = [kept.path for kept in found]
            if names == before:
                break
            before = names
        return found

    def known(self, kept: RecordFile) -> Source | None:
        """Source of a closed recording without reading the recording; None where there is no sound level file."""
        with self._lock:
            size, source = self._sources.get(kept.path, (0, None))
            if source is not None and size == kept.size:
                return source
            if (held := self._held.get(kept.path)) is not None:
                return held
        try:
            written = LevelFile(kept.path, kept.size)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self.spoiled(kept, str(error))
            return None
        with self._lock:
            self._sources[kept.path] = (kept.size, written)
        return written

    def spoiled(self, kept: RecordFile, reason: str) -> None:
        """Forget and remove a level file that is damaged: it is made anew."""
        with self._lock:
            self._sources.pop(kept.path, None)
            self.counts["damaged"] += 1
        path = level_file.path_of(kept.path)
        log.warning("%s %s: it is made anew", path, reason)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            self.problem = f"{path} cannot be removed: {why(error)}"

    def made(self, kept: RecordFile, deadline: float, pace: Pace) -> Source | None:
        """Source of a closed recording, made if it is not there; None where that cannot be.

        Waits for another thread that makes one until monotonic time ``deadline``, s; ``pace`` is called after each
        chunk, and may raise.
        """
        if (source := self.known(kept)) is not None:
            return source
        patience = min(max(deadline - time.monotonic(), 0), threading.TIMEOUT_MAX)
        if self._waits(kept.path) or not self._building.acquire(timeout=patience):
            return None
        try:
            with self._readable(kept):
                return self.known(kept) or self._keep(kept, gather(kept.path, EVERYTHING, pace))
        finally:
            self._building.release()
        return None

    def growing(self, kept: RecordFile) -> Growing:
        """The recording that is open under this name."""
        with self._lock:
            return self._growing.setdefault(_closed_name(kept.path), Growing(kept.path))

    def source(self, kept: RecordFile, until: float, *, curves: bool = True) -> Source | None:
        """Source of a recording, made if it is not there; without ``curves`` it may lack its levels, and is not made.

        None where nothing in it can be read. Raises ``TimeoutError`` where that takes beyond monotonic time ``until``.
        """
        pace = ends_at(until)
        with self._readable(kept):
            if not kept.closed:
                growing = self.growing(kept)
                with growing.lock:
                    if not growing.grow(until):
                        raise TimeoutError
                    return Held(growing.gathered, curves=curves)
            source = self.made(kept, until, pace) if curves else self.known(kept)
            if source is not None or self._waits(kept.path):
                return source
            pace()
            return None if curves else Held(gather(kept.path, TELLING, pace), curves=False)
        return None

    def chunks(self, kept: RecordFile, until: float) -> tuple[Places, Mapping[int, Track]]:
        """The chunks of a recording, and the readers of their channels.

        Raises ``TimeoutError`` at monotonic time ``until``, ``OSError`` and ``RecordingError``.
        """
        if not kept.closed:
            growing = self.growing(kept)
            with growing.lock:
                if not growing.grow(until):
                    raise TimeoutError
                return list(growing.places), growing.tracks
        with self._surveying:
            size, places, tracks = self._chunks.get(kept.path, (0, (), {}))
            if size != kept.size:
                contents = survey(kept.path).contents
                places = [(c.offset, c.length, c.start, c.end) for c in contents.chunks]
                tracks = tracks_of(contents.channels)[0]
                self._chunks[kept.path] = (kept.size, places, tracks)
                while len(self._chunks) > CHUNKS:
                    self._chunks.popitem(last=False)
            self._chunks.move_to_end(kept.path)
            return places, tracks

    def room(self) -> bool:
        """True where the disk has room for level files, and takes them."""
        try:
            return not self._waits(self.folder) and shutil.disk_usage(self.folder).free >= RESERVE
        except OSError:
            return False

    def let_go(self) -> None:
        """Forget what is in memory for want of room, so that it is written."""
        with self._lock:
            for path in [path for path in self._held if self._allowed(path)]:
                del self._held[path]

    def _waits(self, path: Path) -> bool:
        return time.monotonic() < self._again.get(path, 0.0)

    def tidy(self) -> None:
        """Forget recordings that are gone, and remove their level files."""
        recordings = self.recordings()
        there = {_closed_name(known.path) for known in recordings}
        growing = {_closed_name(known.path) for known in recordings if not known.closed}
        with self._lock:
            for known, kept in (
                (self._sources, there),
                (self._held, there),
                (self._again, {*there, self.folder}),
                (self._growing, growing),
            ):
                for path in known.keys() - kept:
                    del known[path]
        for _, entry in self.budget.files():
            if self.folder / f"{entry.name.removesuffix(level_file.SUFFIX)}.mcap" not in there:
                Path(entry.path).unlink(missing_ok=True)
                self.counts["removed"] += 1
        self._hold()

    def _hold(self) -> None:
        """Remove the level files beyond the budget, and forget them. Raises ``OSError``."""
        if gone := self.budget.hold():
            with self._lock:
                self.counts["over budget"] += gone
                for path in [path for path in self._sources if not self._allowed(path)]:
                    del self._sources[path]

    def _allowed(self, recording: Path) -> bool:
        name = FileName.parse(recording.name)
        return name is None or self.budget.allows(name)

    def stats(self) -> dict[str, Any]:
        """Figures for health messages."""
        return {
            **{k: self.counts[k] for k in ("made", "unwritten", "damaged", "removed", "over budget", "unreadable")},
            "problem": self.problem,
        }

    def _keep(self, kept: RecordFile, gathered: Gathering) -> Source:
        """Write a level file, or hold in memory what it would have."""
        allowed = self.budget.allows(kept.name)
        if allowed and self.room():
            try:
                level_file.write(kept.path, kept.size, gathered)
                written = LevelFile(kept.path, kept.size)
            except (OSError, ValueError) as error:
                if kept.path.exists():  # otherwise it went with its recording
                    self.problem = f"{level_file.path_of(kept.path)} cannot be written: {error}"
                    self._again[self.folder] = time.monotonic() + RETRY
            else:
                with self._lock:
                    self.counts["made"] += 1
                    self.problem = ""
                    self._held.pop(kept.path, None)
                    self._sources[kept.path] = (kept.size, written)
                self._hold()
                return written if self.budget.allows(kept.name) else Held(gathered)
        elif allowed and not self._waits(self.folder):
            self.problem = f"{self.folder} has no room for level files: curves of long spans are slow"
        held = Held(gathered)
        with self._lock:
            self.counts["unwritten"] += allowed
            self._held[kept.path] = held
            while len(self._held) > 1 and sum(h.size for h in self._held.values()) > HELD:
                self._held.popitem(last=False)
        return held

    @contextmanager
    def _readable(self, kept: RecordFile) -> Iterator[None]:
        """Count and tell a recording that cannot be read, but for one that was removed to make room."""
        try:
            yield
        except TimeoutError:
            raise
        except (OSError, RecordingError) as error:
            if not isinstance(error, FileNotFoundError) and not isinstance(error.__cause__, FileNotFoundError):
                self.counts["unreadable"] += 1
                self.problem = str(error)
                self._again[kept.path] = time.monotonic() + RETRY
                log.warning("%s has no curves: %s", kept.path, error)


def near(recordings: Iterable[RecordFile], start: int, end: int) -> list[RecordFile]:
    """Recordings that may have something of a span in UTC ns: begun before its end, and written after its start."""
    late = LATE * 1e9
    return [k for k in recordings if k.name.session < end + late and (not k.closed or k.modified * 1e9 + late >= start)]


def ends_at(until: float) -> Pace:
    """No rests, and ``TimeoutError`` at monotonic time ``until``."""

    def pace() -> None:
        if time.monotonic() > until:
            raise TimeoutError

    return pace


def _closed_name(path: Path) -> Path:
    """Path that a recording has once it is closed."""
    return path.with_name(path.name.removesuffix(".part"))
