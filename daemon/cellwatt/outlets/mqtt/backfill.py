"""What the broker missed, out of the record, row by row and not too fast."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from cellwatt.account import Account
from cellwatt.errors import RecordingError, why
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.past import Archived, Part, read
from cellwatt.outlets.selection import Row

PART: Final = 500
"""Rows that are read from the record at a time."""
PAUSE: Final = 1.0
"""s before the record is read again that has not got as far yet."""


@dataclass(frozen=True, slots=True)
class Past:
    """A row or result of the past, and what is to be done once it has arrived."""

    entry: Row | Archived
    arrived: Callable[[], None]


class Backfill:
    """Reads what is owed out of the ``record`` of a cell, span by span; ``problem`` is why it cannot."""

    def __init__(
        self, settings: MqttSettings, record: tuple[Path, str], cursor: Cursor, outbox: Outbox, account: Account
    ) -> None:
        self.problem: str | None = None
        self._settings, self._record = settings, record
        self._cursor, self._outbox, self._account = cursor, outbox, account
        self._lane: asyncio.Queue[Past] = asyncio.Queue(1)
        self._due = 0.0
        """Monotonic time, s, at which the next entry may go."""

    def next(self) -> Past | None:
        """What is to be sent now, if anything is."""
        return None if self._lane.empty() else self._lane.get_nowait()

    async def run(self) -> None:
        """Read, and hand over row by row, until cancelled."""
        while True:
            await self._cursor.lacking.wait()
            gap = self._cursor.first
            if gap is None or not self._outbox.serving or self._outbox.last is None or await self._fill(*gap):
                await asyncio.sleep(PAUSE)

    async def _fill(self, after: int, until: int) -> bool:
        """Bring a part of a span to its arrival; true where the record has not got as far yet."""
        part = await self._read(after, until)
        for result in part.results:  # before the rows, which note how far all is
            await self._hand_over(result, partial(self._account.count, "results back-filled"))
        for row in part.rows:
            await self._hand_over(row, partial(self._sent, after, row.time))
            after = row.time
        await self._lane.join()
        self._cursor.pay(after, part.until)
        return part.waits

    async def _read(self, after: int, until: int) -> Part:
        before = after < self._outbox.begun  # results of before this start did not wait in our queue
        until = min(until, self._outbox.begun) if before else until
        work = partial(read, *self._record, self._settings, after, until, PART, results=before)
        try:
            part = await asyncio.to_thread(work)
        except (OSError, RecordingError) as error:
            reason = why(error) if isinstance(error, OSError) else str(error)
            self.problem = f"record.folder {self._record[0]} cannot be read for back-fill: {reason}"
            self._account.count("record unreadable")
            return Part(after, waits=True)
        self.problem = None
        return part

    async def _hand_over(self, entry: Row | Archived, note: Callable[[], None]) -> None:
        """Have an entry sent, as soon as the rate allows."""
        now = time.monotonic()
        self._due = max(self._due + 1.0 / self._settings.backfill, now - 0.01)
        if self._due > now + 0.005:
            await asyncio.sleep(self._due - now)
        await self._lane.put(Past(entry, partial(self._arrived, note)))
        self._outbox.wake.set()

    def _arrived(self, note: Callable[[], None]) -> None:
        note()
        self._lane.task_done()

    def _sent(self, after: int, time_: int) -> None:
        self._account.count("rows back-filled")
        self._account.receive()
        self._cursor.pay(after, time_, 1)
