"""Keeps an InfluxDB up to date: what is new first, then what it missed, from the record."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cellwatt.account import Account
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item
from cellwatt.outlets.historian.client import Client
from cellwatt.outlets.historian.filling import Reached, lines_of, load, save
from cellwatt.outlets.historian.line_protocol import result_line, row_line
from cellwatt.outlets.historian.recorded import Archived
from cellwatt.outlets.historian.sending import Sender
from cellwatt.outlets.historian.settings import InfluxSettings
from cellwatt.outlets.selection import Picker
from cellwatt.record.messages import time_of
from cellwatt.results import Alarm, Energy, Task

log = logging.getLogger(__name__)

BLOCKS: Final = 2048
"""Items that may wait until they are put into lines."""
AT_ONCE: Final = 4
"""Items that are put into lines before the loop may turn to something else."""
MARGIN: Final = 60 * 10**9
"""ns in front of the last row written which are filled in again after a restart: results come later than their time."""
SETTLED: Final = 3 * 10**9
"""ns after which all of a moment is in the record."""
ROWS: Final = 300
"""Rows that are filled in with one reading of the record."""
SAVED: Final = 1.0
"""s between two writings of the positions."""
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0  # s
LAST: Final = 2.0
"""Longest time, s, of the last request when the outlet ends."""

Pending = tuple[int, str]
"""Time, UTC ns, and line."""


class Influx:
    """One database or bucket of a cell. ``record`` is the folder of the record, ``None`` where there is none."""

    def __init__(self, settings: InfluxSettings, view: CellView, record: Path | None, account: Account) -> None:
        self._settings, self._record, self._account = settings, record, account
        self._cell = view.cell
        self._tags = {"site": view.site, "cell": view.cell}
        self._place = f"{settings.url} {settings.database or settings.bucket} {settings.org or ''}".strip()
        self._items: deque[Frames | Archived] = deque()
        self._pending: deque[Pending] = deque()
        self._picker: Picker | None = None
        self._reached = Reached()
        self._begun = self._loaded = False
        self._newest = 0
        self._pause, self._not_before, self._saved_at = 0.0, 0.0, 0.0
        self._saved = b""
        self.problem: str | None = None
        """Reason why nothing can be written now; ``None`` if all is well."""
        self._fill_from = 0.0
        self.unread: str | None = None
        """Reason why nothing can be filled in; ``None`` if all is well."""

    def offer(self, item: Item) -> None:
        """Queue an item; beyond the room for them the oldest is filled in from the record later."""
        if isinstance(item, Frames) or (self._settings.results and isinstance(item, Alarm | Task | Energy)):
            self._items.append(item)
            if len(self._items) > BLOCKS:
                self._forgo_item(self._items.popleft())

    async def run(self) -> None:
        """Write until cancelled, then once more, and keep what is left to be filled in."""
        if self._record is not None and not self._loaded:
            before = await asyncio.to_thread(load, self._record, self._place)
            for span in self._reached.gaps:  # what was offered meanwhile, beyond the room for it
                before.gaps.add(*span)
            self._reached, self._loaded = before, True
        async with Client(self._settings) as client:
            sender = Sender(client, self._account, self._record)
            try:
                while True:
                    await self._turn(sender)
            finally:
                await self._end(sender)

    # one turn -------------------------------------------------------------------------------------

    async def _turn(self, sender: Sender) -> None:
        await self._collect()
        ready = time.monotonic() >= self._not_before
        if ready and self._pending:
            await self._send_live(sender)
        elif ready and (span := self._due()) is not None:
            await self._fill(sender, span)
        await self._save()
        if not self._pending or time.monotonic() < self._not_before:
            filling = time.monotonic() >= self._not_before and self._due() is not None
            await asyncio.sleep(0.0 if filling else min(self._settings.every, 1.0))

    async def _collect(self) -> None:
        """Put what was offered into lines, a few at a time: after a request that hung there are many."""
        for n in range(1, len(self._items) + 1):
            item = self._items.popleft()
            if isinstance(item, Frames):
                self._take_frames(item)
            elif text := result_line(self._settings.measurement, self._tags, item):
                self._pending.append((time_of(item), text))
            while len(self._pending) > self._settings.queue:
                self._forgo(self._pending.popleft()[0])
            if n % AT_ONCE == 0:
                await asyncio.sleep(0)

    def _take_frames(self, frames: Frames) -> None:
        if not len(frames):
            return
        self._newest = int(frames.time[-1])
        picker = self._picker
        if picker is None or (picker.layout is not frames.layout and picker.layout != frames.layout):
            picker = self._picker = Picker(self._settings, frames.layout)
            if picker.unmatched:
                self._account.count("influx: patterns that fit no channel", len(picker.unmatched))
                log.warning("influx: no channel fits %s", ", ".join(picker.unmatched))
        for row in picker.rows(frames):
            if self._record is not None and not self._begun:
                self._begin(row.time, picker.span)
            elif text := row_line(self._settings.measurement, self._tags, row):
                self._pending.append((row.time, text))
            self._begun = True

    def _begin(self, first: int, span: int) -> None:
        """Leave the first row, of whose span we may have seen a part, and what came before it to the record."""
        until = self._reached.until
        self._reached.gaps.add(first - span if until is None else min(until - MARGIN, first - span), first)

    def _forgo_item(self, item: Frames | Archived) -> None:
        if isinstance(item, Frames):
            span = self._picker.span if self._picker is not None else round(1e9 / self._settings.rate)
            self._forgo(int(item.time[-1]), int(item.time[0]) - span)
        else:
            self._forgo(time_of(item))

    def _forgo(self, end: int, start: int | None = None) -> None:
        """Leave what is not written to the record, whole rows of it; without one it is lost."""
        if self._record is None:
            self._account.lose(1, "influx: queue")
            return
        span = self._picker.span if self._picker is not None else round(1e9 / self._settings.rate)
        start = end - 1 if start is None else start
        self._reached.gaps.add(start // span * span, -(-end // span) * span)

    # requests -------------------------------------------------------------------------------------

    async def _send_live(self, sender: Sender) -> None:
        batch = [self._pending.popleft() for _ in range(min(self._settings.batch, len(self._pending)))]
        try:
            left = await self._send(sender, [text for _, text in batch])
        except BaseException:
            self._pending.extendleft(reversed(batch))
            raise
        if left:
            kept = set(left)
            self._pending.extendleft(reversed([entry for entry in batch if entry[1] in kept]))
        elif batch:
            newest = max(at for at, _ in batch)
            self._reached.until = max(newest, self._reached.until or 0)

    def _due(self) -> tuple[int, int] | None:
        """The next part of what is to be filled in, if the record has it by now."""
        if self._record is None or self._picker is None or time.monotonic() < self._fill_from:
            return None
        rows = min(self._settings.batch, ROWS)
        return self._reached.gaps.first(rows * self._picker.span, self._newest - SETTLED)

    async def _fill(self, sender: Sender, span: tuple[int, int]) -> None:
        assert self._record is not None
        try:
            lines = await asyncio.to_thread(lines_of, self._record, self._cell, self._settings, self._tags, span)
        except (CellwattError, OSError) as error:
            self._account.count("influx: readings of the record that failed")
            self._fill_from = time.monotonic() + LONGEST_PAUSE
            self.unread = f"influx: what was missed cannot be read from the record: {' '.join(str(error).split())}"
            return
        self.unread = None
        for first in range(0, len(lines), self._settings.batch):
            if await self._send(sender, lines[first : first + self._settings.batch]):
                return
            await self._collect()
            while self._pending and time.monotonic() >= self._not_before:  # what is new goes first
                await self._send_live(sender)
        self._account.count("influx: lines filled in", len(lines))
        self._reached.gaps.remove(*span)

    async def _send(self, sender: Sender, lines: Sequence[str]) -> Sequence[str]:
        """Send lines; return those that are left since the server takes nothing now."""
        sent = await sender.send(lines)
        if sent.later is None:
            self._pause, self.problem = 0.0, None
            return ()
        self._pause = min(max(2 * self._pause, FIRST_PAUSE), LONGEST_PAUSE)
        wait = self._pause if sent.later.wait is None else sent.later.wait
        self._not_before = time.monotonic() + wait
        self.problem = f"influx: {self._settings.url}: {sent.later.reason}; trying again in {wait:.1f} s"
        return sent.rest

    # positions ------------------------------------------------------------------------------------

    async def _save(self, *, now: bool = False) -> None:
        if self._record is None or (not now and time.monotonic() - self._saved_at < SAVED):
            return
        content = self._reached.text(self._place)
        if content != self._saved:
            problem = await asyncio.to_thread(save, self._record, content)
            if problem is not None:
                self._account.count("influx: positions not kept")
            self._saved = content if problem is None else b""
        self._saved_at = time.monotonic()

    async def _end(self, sender: Sender) -> None:
        """Write what waits, once; leave the rest to the record."""
        await self._collect()
        if self._pending and time.monotonic() >= self._not_before:
            try:
                async with asyncio.timeout(LAST):
                    await self._send_live(sender)
            except TimeoutError:
                self._account.count("influx: last request given up")
        while self._pending:
            self._forgo(self._pending.popleft()[0])
        await self._save(now=True)
