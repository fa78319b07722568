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
from cellwatt.errors import why
from cellwatt.outlets.mqtt.books import Books
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.past import Part, read
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.selection import Row

PART: Final = 500
"""Rows that are read from the record at a time."""
PAUSE: Final = 1.0
"""s before the record is read again that has not got as far yet."""


@dataclass(frozen=True, slots=True)
class Archive:
    """The record that back-fill is read from."""

    folder: Path
    cell: str


@dataclass(frozen=True, slots=True)
class Past:
    """A row of the past, or the end of a gap, and what is to be done once it has arrived."""

    row: Row | None
    arrived: Callable[[], None]


class Backfill:
    """Reads the gaps that the books have, one after the other; ``problem`` is why it cannot."""

    def __init__(
        self, settings: MqttSettings, archive: Archive, books: Books, outbox: Outbox, account: Account
    ) -> None:
        self.problem: str | None = None
        self._settings = settings
        self._archive = archive
        self._books = books
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
            await self._books.owed.wait()
            gap = self._books.gap
            if gap is None or not self._outbox.serving or self._outbox.last is None:
                await asyncio.sleep(PAUSE)
                continue
            await self._fill(*gap, pace)

    async def _fill(self, after: int, until: int, pace: _Pace) -> None:
        self._filled.clear()
        whole = False
        while not whole:
            part = await self._read(after, until)
            for row in part.rows:
                await pace.wait()
                await self._hand_over(Past(row, partial(self._sent, row.time, until)))
                after = row.time
            if part.waits:
                await asyncio.sleep(PAUSE)
            whole = part.whole
        await self._hand_over(Past(None, partial(self._whole, until)))
        await self._filled.wait()

    async def _read(self, after: int, until: int) -> Part:
        archive = self._archive
        try:
            part = await asyncio.to_thread(read, archive.folder, archive.cell, self._settings, after, until, PART)
        except OSError as error:
            self.problem = f"record.folder {archive.folder} cannot be read for back-fill: {why(error)}"
            self._account.count("record unreadable")
            return Part(waits=True)
        self.problem = None
        return part

    async def _hand_over(self, past: Past) -> None:
        await self._lane.put(past)
        self._outbox.wake.set()

    def _sent(self, time_: int, until: int) -> None:
        self._account.count("rows back-filled")
        self._books.filled(time_, until)

    def _whole(self, until: int) -> None:
        self._books.filled(until, until)
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
