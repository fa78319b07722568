"""The recorder: takes items from the event loop and writes them in its own thread."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cellwatt.batch import Batch, Tick
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.record.container import Contents
from cellwatt.record.encoder import Item, topic_of_block
from cellwatt.record.files import CHUNK, OK, Entry, Files
from cellwatt.record.header import Header
from cellwatt.record.messages import TOPICS, Health
from cellwatt.record.settings import RecordSettings
from cellwatt.record.upkeep import Upkeep
from cellwatt.results import Event

LOOK, IDLE = 0.5, 5.0
"""Periods in s of the upkeep of files while nothing arrives: before and after all written data are synced to disk."""
OVERHEAD = 1000
"""Bytes of memory of a block beside its arrays."""
SIZES = {Tick: 300, Event: 1000, Health: 8000}
"""Bytes of memory of a message by kind; other kinds need 2000."""


class Recorder:
    """Writes everything of one session into ``settings.folder``.

    ``put`` is called on the event loop, only enqueues, and returns ``False`` if the item was refused because the queue
    is full (or the recorder is not running); refused items are counted. A disk that is full, read-only or broken stops
    the writing, never the daemon: waiting items stay in memory up to ``settings.queue`` bytes, the oldest recordings
    are deleted to make room, and writing continues in a new file as soon as it can. ``now`` is the cell's clock.
    """

    def __init__(self, settings: RecordSettings, header: Header, now: Callable[[], int] = time.time_ns) -> None:
        self.settings = settings
        self.cell, self.session = header.cell, header.session
        self.gathered = 0.0
        """s that items have waited before ``put``, so that none waits for longer than ``settings.flush`` in total."""
        self.upkeep = Upkeep(settings, header.cell, header.session, now)
        self._files = Files(settings, header, self.upkeep)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._wake = threading.Condition()
        # Guarded by _wake:
        self._queue: deque[Entry] = deque()
        self._bytes = 0
        self._first_at = float("inf")
        """Monotonic s at which the first item in the queue that must be written soon was put."""
        self._accepted = self._settled = self._flush_to = 0
        self._running = False
        self._drops: Counter[str] = Counter()
        # Used by the thread alone: items taken from the queue and not yet on disk.
        self._held: deque[Entry] = deque()

    def start(self) -> None:
        """Start writing; files left open by an earlier run are recovered in parallel.

        Raises ``RecordingError`` if the folder cannot be created.
        """
        try:
            self.settings.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f"record.folder {self.settings.folder} cannot be created: {error.strerror}") from error
        self._running = True
        self.upkeep.start()
        self._thread.start()

    async def close(self) -> None:
        """Write all waiting items, close the file, and end the thread."""
        await asyncio.to_thread(self._close)

    def _close(self) -> None:
        with self._wake:
            running, self._running = self._running, False
            self._wake.notify_all()
        if running:
            self._thread.join()
            self.upkeep.close()

    def put(self, item: Item, number: int | None = None) -> bool:
        """Record an item, a result or event under its number; return ``False`` if it was refused.

        Empty blocks are ignored, and so are frames if the settings exclude them. Health is written together with the
        next item, or after ``IDLE`` s.
        """
        if not isinstance(item, Batch | Frames):
            entry = Entry(item, SIZES.get(type(item), 2000), TOPICS[type(item)], 1, number)
        elif len(item) and (isinstance(item, Batch) or self.settings.frames):
            each = 40 * len(item) if isinstance(item, Batch) else item.bound.nbytes + item.quality.nbytes
            entry = Entry(item, item.values.nbytes + each + OVERHEAD, topic_of_block(item), len(item))
        else:
            return True
        with self._wake:
            if not self._running or (self._bytes and self._bytes + entry.size > self.settings.queue):
                self._drops[entry.topic] += entry.n
                return False
            first = self._first_at == float("inf") and not isinstance(item, Health)
            if first:
                self._first_at = time.monotonic() - self.gathered
            self._queue.append(entry)
            self._bytes += entry.size
            self._accepted += 1
            # Wake the thread for the first item, so that it notes the deadline, and for a full chunk; not in between.
            if first or self._bytes > CHUNK:
                self._wake.notify_all()
        return True

    def redeclare(self, header: Header) -> None:
        """Continue in a new file under this header (of the same session), because the settings changed."""
        with self._wake:
            self._queue.append(Entry(header, 0, "", 0))
            self._accepted += 1

    def flush(self, timeout: float) -> bool:
        """Wait until all items taken so far are in the file; return whether they are. Never call on the event loop."""
        with self._wake:
            target = self._flush_to = self._accepted
            self._wake.notify_all()
            self._wake.wait_for(lambda: self._settled >= target or not self._thread.is_alive(), timeout)
            return self._settled >= target

    def progress(self) -> tuple[int, int]:
        """Number of items taken so far, and how many of them, from the first on, are written or refused."""
        return self._accepted, self._settled

    def live(self) -> tuple[Path, Contents] | None:
        """The file being written, and its contents on disk so far; another thread extends them."""
        file = self._files.open
        return None if file is None else (file.part, file.contents)

    def stats(self) -> dict[str, Any]:
        """Figures for health messages; ages in s, sizes in bytes.

        ``overdue``: time beyond ``flush``, s, for which nothing was written although items wait.
        """
        files = self._files
        waiting, age = self._accepted - self._settled, time.monotonic() - files.flushed_at
        open_file, (state, problem) = files.open, files.state
        return {
            "state": state,
            "problem": problem,
            "file": open_file.part.name if open_file else None,
            "files": files.count,
            "bytes": files.bytes,
            "queue": {"items": waiting, "bytes": self._bytes},
            "flush_age": round(age, 3),
            "overdue": round(max(0.0, age - self.settings.flush), 3) if waiting else 0.0,
            "samples": dict(files.samples),
            "drops": dict(self._drops + files.refused),
            "displaced": files.displaced,
            **self.upkeep.stats(),
        }

    def _work(self) -> None:
        while self._wait():
            self._files.write(self._held)
            self._settle()
            self._files.look_after()
        self._files.write(self._held)
        self._settle()
        self._files.close()
        with self._wake:
            for entry in self._held:
                self._drops[entry.topic] += entry.n
            self._wake.notify_all()

    def _wait(self) -> bool:
        """Sleep until there is work, and take over the queue; return ``False`` at the end."""
        with self._wake:
            end = time.monotonic() + (IDLE if self._files.synced else LOOK)
            while self._running and (pause := min(self._due(), end) - time.monotonic()) > 0:
                self._wake.wait(pause)
            self._held += self._queue
            self._queue.clear()
            self._first_at = float("inf")
            return self._running

    def _due(self) -> float:
        """When to write next, monotonic s."""
        if not self._queue and not self._held:
            return float("inf")
        if self._files.state != OK:
            return self._files.retry_at
        if self._bytes > CHUNK or self._settled < self._flush_to:
            return 0.0
        return self._first_at + self.settings.flush

    def _settle(self) -> None:
        with self._wake:
            self._settled = self._accepted - len(self._queue) - len(self._held)
            self._bytes = sum(e.size for e in self._queue) + sum(e.size for e in self._held)
            self._wake.notify_all()
