"""The files of one session, one open at a time, and the handling of disk errors."""

from __future__ import annotations

import errno
import logging
import time
from collections import Counter, deque
from dataclasses import replace
from typing import Any, NamedTuple

from cellwatt.record.encoder import Encoder, Item, Redeclared
from cellwatt.record.folder import listing
from cellwatt.record.header import FileName, Header
from cellwatt.record.openfile import DisplacedError, OpenFile
from cellwatt.record.settings import RecordSettings
from cellwatt.record.upkeep import Upkeep, is_full

log = logging.getLogger(__name__)

CHUNK = 1 << 20
"""A chunk is written when it holds this many bytes, or when its first sample has waited long enough."""
OK = ("ok", "")
RETRY = 1.0
"""Pause after a disk error, s."""
RETAIN_EVERY = 60.0
"""Period in s at which files are compared with age and budget, and failed repairs are tried again."""


class Entry(NamedTuple):
    """An item to be written: its ``size`` in memory, and the ``n`` messages it becomes under ``topic``.

    ``number`` is that of a result or event in its series.
    A header as item means that the following entries belong into a new file under this header.
    """

    item: Item | Header
    size: int
    topic: str
    n: int
    number: int | None = None


class Files:
    """Writes entries into files named after the header; used by the recorder's thread alone."""

    def __init__(self, settings: RecordSettings, header: Header, upkeep: Upkeep) -> None:
        self.state = OK
        """``ok``, ``disk full``, ``read-only`` or ``disk error``, and a line about it: threads read both at once."""
        self.open: OpenFile | None = None
        self.samples: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.displaced: dict[str, Any] = {"files": 0, "messages": 0, "reason": ""}
        """Files that were removed or moved away while they were written, and the messages that the record lacks."""
        self.bytes = self.count = 0
        self.flushed_at = self.retry_at = self._synced_at = self._retained_at = time.monotonic()
        self._opened_at = 0.0
        self._of_file: Counter[str] = Counter()
        self.synced = True
        """All written data have been synced to disk."""
        self._settings = settings
        self._header = header
        self._upkeep = upkeep
        self._number = 1
        self._encoder: Encoder | None = None

    def write(self, held: deque[Entry]) -> None:
        """Write entries in order; those written (or that cannot be encoded) are removed from ``held``.

        After a disk error the others stay, for a later call at or after ``retry_at``.
        """
        try:
            while held:
                taken, counts = self._fill(held)
                self._commit()
                for _ in range(taken):
                    held.popleft()
                self.samples.update(counts)
                self._of_file.update(counts)
                if self.open is not None and self.open.size >= self._upkeep.rotate_at:
                    self.rotate()
        except OSError as error:
            self._fail(error)

    def look_after(self) -> None:
        """Sync, rotate and remove files when due."""
        now = time.monotonic()
        try:
            if self.open is not None and 0 < self._settings.file_age <= now - self._opened_at:
                self.rotate()
            due = not self.synced and now - self._synced_at >= self._settings.sync
            if self.open is not None and due and self._upkeep.sync(self.open):
                self.synced, self._synced_at = True, now
        except OSError as error:
            self._fail(error)
        if now - self._retained_at >= RETAIN_EVERY:
            self._retained_at = now
            self._upkeep.retain()
            if self.state == OK:
                self._upkeep.repair_left()

    def rotate(self) -> None:
        """End the open file; the next entry opens a new one. Raises ``OSError``."""
        file, self._encoder = self.open, None
        if file is None:
            return
        file.check_place()
        file.finish()
        self.open = None
        self._upkeep.publish(file)

    def close(self) -> None:
        """End the open file; after a disk error the next start repairs it."""
        try:
            self.rotate()
        except OSError as error:
            self._fail(error)

    def _fill(self, held: deque[Entry]) -> tuple[int, Counter[str]]:
        """Put entries into the open file's chunk; return their number, and their messages by topic."""
        taken, counts = 0, Counter[str]()
        for entry in held:
            if isinstance(entry.item, Header):
                if not taken:
                    self.rotate()
                    self._header = entry.item
                    taken = 1
                break
            file, encoder = self._ready()
            if file.waiting > CHUNK:
                break
            try:
                encoder.add(entry.item, entry.number)
                counts[entry.topic] += entry.n
            except Redeclared:
                if not taken:
                    self.rotate()
                break
            except Exception:
                # One item that cannot be written must not end the recording of all others.
                log.exception("an item for %s cannot be recorded", entry.topic)
                self.refused[entry.topic] += entry.n
            taken += 1
        return taken, counts

    def _ready(self) -> tuple[OpenFile, Encoder]:
        if self.open is None or self._encoder is None:
            if not self.count:
                # The first file number that no earlier process of this session has used.
                names = (stored.name for stored in listing(self._settings.folder, self._header.cell))
                used = (name.number for name in names if name.session == self._header.session)
                self._number = 1 + max(used, default=0)
            self._settings.folder.mkdir(parents=True, exist_ok=True)  # the folder may have been removed
            header = replace(self._header, number=self._number)
            name = str(FileName(header.session, header.number, header.cell))
            try:
                self.open = OpenFile(self._settings.folder / name, header)
            except FileExistsError:
                self._number += 1
                raise
            self._number += 1
            self._encoder = Encoder(self.open)
            self._opened_at = time.monotonic()
            self._of_file.clear()
            self._upkeep.sync_folder()
            self.count += 1
            self.bytes += self.open.size
        return self.open, self._encoder

    def _commit(self) -> None:
        file = self.open
        if file is None:
            return
        before = file.size
        file.write_chunk()
        self.bytes += file.size - before
        self.flushed_at = time.monotonic()
        self.synced = False
        if self.state != OK:
            self.state = OK
            self._upkeep.repair_left()

    def _displaced(self, error: DisplacedError) -> None:
        """Continue in a new file; messages that the record lacks now are counted as refused."""
        file, self.open, self._encoder = self.open, None, None
        if file is not None:
            file.leave()
        self.samples -= self._of_file
        self.refused += self._of_file
        lost = self._of_file.total()
        self.displaced = {
            "files": self.displaced["files"] + 1,
            "messages": self.displaced["messages"] + lost,
            "reason": f"{error.strerror}: the record lacks its {lost} messages",
        }
        log.error("%s; recording continues in a new file", self.displaced["reason"])

    def _fail(self, error: OSError) -> None:
        if isinstance(error, DisplacedError):
            self._displaced(error)
            return
        file, self.open, self._encoder = self.open, None, None
        if file is not None:
            file.abandon()
            if file.contents.chunks:
                self._upkeep.leave(file.part)
        kind = "disk full" if is_full(error) else "read-only" if error.errno == errno.EROFS else "disk error"
        self.state = kind, f"{self._settings.folder} cannot be written: {error.strerror}"
        room = is_full(error) and self._upkeep.make_room()
        self.retry_at = time.monotonic() + (0.0 if room else RETRY)
