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
    """A row or result of the past, or the end of a gap, and what is to be done once it has arrived."""

    entry: Row | Archived | None
    arrived: Callable[[], None]


class Backfill:
    """Reads what is owed out of the ``record`` of a cell, span by span; ``problem`` is why it cannot."""

    def __init__(
        self, settings: MqttSettings, record: tuple[Path, str], cursor: Cursor, outbox: Outbox, account: Account
    ) -> None:
        self.problem: str | None = None
        self._settings = settings
        self._record = record
        self._cursor = cursor
        self._outbox = outbox
        self._account = account
        self._lane: asyncio.Queue[Past] = asyncio.Queue(1)
        self._filled = asyncio.Event()

    def next(self) -> Past | None:
        """What is to be sent now, if anything is."""
        return None if self._lane.empty() else self._lane.get_nowait()

    async def run(self) -> None:
        """Read, and hand over row by row, until cancelled."""
        pace = _Pace(self._settings.backfill)
        while True:
            await self._cursor.lacking.wait()
            gap = self._cursor.first
            if gap is None or not self._outbox.serving or self._outbox.last is None:
                await asyncio.sleep(PAUSE)
                continue
            await self._fill(*gap, pace)

    async def _fill(self, after: int, until: int, pace: _Pace) -> None:
        self._filled.clear()
        part = await self._read(after, until)
        for result in part.results:  # before the rows, which note how far all is
            await pace.wait()
            await self._hand_over(Past(result, partial(self._account.count, "results back-filled")))
        for row in part.rows:
            await pace.wait()
            await self._hand_over(Past(row, partial(self._sent, after, row.time)))
            after = row.time
        await self._hand_over(Past(None, partial(self._done, after, part.until)))
        if part.waits:
            await asyncio.sleep(PAUSE)
        await self._filled.wait()

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

    async def _hand_over(self, past: Past) -> None:
        await self._lane.put(past)
        self._outbox.wake.set()

    def _sent(self, after: int, time_: int) -> None:
        self._account.count("rows back-filled")
        self._account.receive()
        self._cursor.pay(after, time_, 1)

    def _done(self, after: int, until: int) -> None:
        self._cursor.pay(after, until)
        self._filled.set()


class _Pace:
    """Lets through ``rate`` calls a second at most."""

    def __init__(self, rate: float) -> None:
        self._step = 1.0 / rate
        self._due = 0.0

    async def wait(self) -> None:
        now = time.monotonic()
        self._due = max(self._due + self._step, now - 0.01)
        if self._due > now + 0.005:
            await asyncio.sleep(self._due - now)
