"""Delivers the rows and results of a cell to one peer at least once: new ones first, then the back-fill."""

from __future__ import annotations

import asyncio
import logging
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, TypeGuard, TypeVar

from pydantic import Field, PositiveInt

from cellwatt.account import Account
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet, OutletSettings
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.past import Archived, read
from cellwatt.outlets.remote import NotNowError
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.quantity import Seconds
from cellwatt.record.header import plain_cell
from cellwatt.record.messages import time_of
from cellwatt.results import Alarm, Energy, Task
from cellwatt.together import until_one_ends

log = logging.getLogger(__name__)

BLOCKS: Final = 2048
"""Most items that wait to be converted into messages."""
AT_ONCE: Final = 4
"""Items converted into messages before the event loop may run other tasks."""
MARGIN: Final = 60 * 10**9
"""Span before the last row sent, ns, that is back-filled again after a kill: results arrive after their time."""
SETTLED: Final = 3 * 10**9
"""Time, ns, after which all entries of a moment are in the record."""
ROWS: Final = 300
"""Most rows back-filled by one read of the record."""
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0  # s
LAST: Final = 2.0
"""Longest time, s, of the final attempt when the outlet ends."""

M = TypeVar("M")


class Peer(ABC, Generic[M]):
    """The part specific to one kind of peer: how entries become messages, and how messages are sent."""

    @abstractmethod
    def row(self, row: Row, units: Mapping[str, str]) -> M | None:
        """The message of a row; ``None`` if the peer has no use for the row. Pure: called again for back-fill."""

    def result(self, result: Archived) -> M | None:
        """The message of an alarm, task or energy, or ``None``."""
        return None

    @abstractmethod
    async def send(self, messages: Sequence[M]) -> Mapping[str, int]:
        """Return once the peer has the messages: the number of messages that it refuses for good, by reason.

        Raises ``NotNowError`` if the peer accepts nothing now: all messages are sent again.
        """


class Flow(Selection):
    """What is sent to a peer, and how fast."""

    results: bool = True
    """Also send alarms, tasks and energies."""
    batch: PositiveInt = Field(default=100, le=50_000)
    """Most messages in one attempt."""
    every: Seconds = Field(default=1.0, gt=0)
    """Time between two attempts while the peer accepts messages and less than a ``batch`` waits."""
    queue: PositiveInt = 10_000
    """Most messages that wait; further ones are back-filled from the record later."""


class Forwarder(Generic[M]):
    """Delivers to one peer the items that the cell offers and the rows and results owed from its record.

    ``record``: folder of the record, or ``None``; ``name`` prefixes counters and messages.
    """

    def __init__(
        self, name: str, peer: Peer[M], flow: Flow, cell: str, record: Path | None, cursor: Cursor, account: Account
    ) -> None:
        self.problem: str | None = None
        """Reason why nothing can be sent now, or ``None``."""
        self.unread: str | None = None
        """Reason why nothing can be back-filled, or ``None``."""
        self.cursor = cursor
        self._name, self._peer, self._cell, self._record, self._account = name, peer, cell, record, account
        self._flow = flow
        self._items: deque[Frames | Archived] = deque()
        self._pending: deque[tuple[int, M, bool]] = deque()
        """(time in UTC ns, message, True if the message is a row)."""
        self._picker = Picker(flow)
        self._begun = False
        self._newest = 0
        self._pause, self._not_before, self._next_live, self._fill_from = 0.0, 0.0, 0.0, 0.0

    @property
    def troubles(self) -> Sequence[str | None]:
        """Reasons why entries are not sent; ``None`` for each that does not apply."""
        return self.problem, self.unread, self.cursor.problem

    def offer(self, item: Item) -> None:
        """Queue an item; when the queue is full, the oldest item is back-filled from the record later."""
        if self._wants(item):
            self._items.append(item)
            if len(self._items) > BLOCKS:
                oldest = self._items.popleft()
                if isinstance(oldest, Frames):
                    self._forgo(int(oldest.time[-1]), 0, int(oldest.time[0]) - self._span)
                else:
                    self._forgo(time_of(oldest), 0)

    def _wants(self, item: Item) -> TypeGuard[Frames | Archived]:
        return (isinstance(item, Frames) and len(item) > 0) or (
            self._flow.results and isinstance(item, Alarm | Task | Energy)
        )

    def succeed(self, before: Forwarder[M]) -> None:
        """Continue from the position of ``before``, with the items that it still had queued, which leave it."""
        self.cursor.succeed(before.cursor)
        while before._items:
            if self._wants(item := before._items.pop()):
                self._items.appendleft(item)

    async def run(self) -> None:
        """Send until cancelled, then once more; store the remaining entries as owed."""
        await self.cursor.open()
        try:
            await until_one_ends(self._serve(), self.cursor.keep())
        finally:
            await self._end()

    async def _serve(self) -> None:
        while True:
            await self._collect()
            if self._live_due():
                await self._send_live()
            elif self._accepts and (span := self._due()) is not None:
                await self._fill(*span)
            if not self._live_due():
                filling = self._accepts and self._due() is not None
                await asyncio.sleep(0.0 if filling else min(self._flow.every, 1.0))

    @property
    def _accepts(self) -> bool:
        """False during the pause after a failed attempt."""
        return time.monotonic() >= self._not_before

    def _live_due(self) -> bool:
        """True if new messages are to be sent now."""
        full = len(self._pending) >= min(self._flow.batch, self._flow.queue)
        return bool(self._pending) and self._accepts and (full or time.monotonic() >= self._next_live)

    # new items -----------------------------------------------------------------------------------

    async def _collect(self) -> None:
        """Convert queued items into messages, a few at a time: after an attempt that hung there are many."""
        for n in range(1, len(self._items) + 1):
            item = self._items.popleft()
            if isinstance(item, Frames):
                self._take_frames(item)
            else:
                self._wait(time_of(item), self._peer.result(item), False)
            while len(self._pending) > self._flow.queue:
                self._forgo(self._pending.popleft()[0], 1)
            if n % AT_ONCE == 0:
                await asyncio.sleep(0)

    def _take_frames(self, frames: Frames) -> None:
        self._newest = int(frames.time[-1])
        picker, before = self._picker, self._picker.layout
        for row in picker.rows(frames):
            self._take_row(row)
        if picker.layout is not before and picker.unmatched:
            self._account.count(f"{self._name}: patterns that fit no channel", len(picker.unmatched))
            log.warning("%s: no channel matches %s", self._name, ", ".join(picker.unmatched))

    def _take_row(self, row: Row) -> None:
        if self._record is not None and not self._begun:
            self._begin(row.time)
        else:
            self._wait(row.time, self._peer.row(row, self._picker.units), True)
        self._begun = True

    def _wait(self, at: int, message: M | None, is_row: bool) -> None:
        if message is not None:
            self._pending.append((at, message, is_row))
            self._account.expect()
            self._account.owed += 1

    def _begin(self, first: int) -> None:
        """Owe the first row, whose span may have begun before this start, and everything before it."""
        reached, ended = self.cursor.position.reached, self.cursor.position.ended
        since = first - self._span if reached is None else reached if ended else reached - MARGIN
        self.cursor.owe(min(since, first - self._span), first)
        self.cursor.deliver(first)

    def _forgo(self, end: int, entries: int, start: int | None = None) -> None:
        """Owe whole rows that are not sent, to be read from the record; without a record they are lost."""
        self._account.owed -= entries
        if self._record is None:
            self._account.expect(1 - entries)
            self._account.miss(1, f"{self._name}: queue")
            return
        start = end - 1 if start is None else start
        self.cursor.owe(start // self._span * self._span, -(-end // self._span) * self._span, entries)

    @property
    def _span(self) -> int:
        """Time between two rows, ns."""
        return self._picker.span

    async def _send_live(self) -> None:
        batch = [self._pending.popleft() for _ in range(min(self._flow.batch, len(self._pending)))]
        sent = False
        try:
            sent = await self._send([message for _, message, _ in batch])
        finally:
            if not sent:
                self._pending.extendleft(reversed(batch))
        if sent:
            self._next_live = time.monotonic() + self._flow.every
            self._account.owed -= len(batch)
            # A result does not prove that the rows before it were delivered: an earlier start may still owe them.
            for at in [at for at, _, is_row in batch if is_row][-1:]:
                self.cursor.deliver(at)

    # back-fill ------------------------------------------------------------------------------------

    def _due(self) -> tuple[int, int] | None:
        """The next span to back-fill, as far as the record has it by now."""
        span = self.cursor.first
        if span is None or self._record is None or time.monotonic() < self._fill_from:
            return None
        after, until = span[0], min(span[1], (self._newest - SETTLED) // self._span * self._span)
        return (after, until) if after < until else None

    async def _fill(self, after: int, until: int) -> None:
        assert self._record is not None
        record, flow = (self._record, self._cell), self._flow
        work = partial(read, *record, flow, after, until, min(flow.batch, ROWS), results=flow.results)
        try:
            span = await asyncio.to_thread(work)
        except (CellwattError, OSError) as error:
            self._account.count(f"{self._name}: readings of the record that failed")
            self._fill_from = time.monotonic() + LONGEST_PAUSE
            reason = " ".join(str(error).split())
            self.unread = f"{self._name}: the record cannot be read for back-fill: {reason}"
            return
        self.unread = None
        found = [*((row.time, self._peer.row(row, span.units)) for row in span.rows)]
        found += [(time_of(result), self._peer.result(result)) for result in span.results]
        entries = sorted(((at, message) for at, message in found if message is not None), key=lambda e: e[0])
        sent = 0
        for first in range(0, len(entries), self._flow.batch):
            batch = entries[first : first + self._flow.batch]
            if not await self._send([message for _, message in batch]):
                return
            sent += len(batch)
            self._account.count(f"{self._name}: entries filled in", len(batch))
            later = entries[first + len(batch) :]
            until = (later[0][0] - 1) // self._span * self._span if later else span.until  # only whole rows are read
            if until > after:  # at once: the cursor never lags behind what was sent
                self.cursor.pay(after, until, sent)
                after, sent = until, 0
            await self._collect()
            while self._live_due():  # new items first
                await self._send_live()
        self.cursor.pay(after, span.until)
        if span.waits:
            self._fill_from = time.monotonic() + 1.0

    async def _send(self, messages: Sequence[M]) -> bool:
        """Send messages; false if the peer accepts nothing now."""
        try:
            refused = await self._peer.send(messages)
        except NotNowError as error:
            self._account.count(f"{self._name}: attempts to be repeated")
            self._pause = min(max(2 * self._pause, FIRST_PAUSE), LONGEST_PAUSE)
            # A server with another clock may name a time in the past.
            wait = self._pause if error.wait is None else max(error.wait, FIRST_PAUSE)
            self._not_before = time.monotonic() + wait
            self.problem = f"{self._name}: {error}; trying again in {wait:.1f} s"
            return False
        self._pause, self.problem = 0.0, None
        self._account.receive(len(messages) - sum(refused.values()))
        for reason, count in refused.items():
            self._account.miss(count, f"{self._name}: {reason}")
        return True

    async def _end(self) -> None:
        """Send the waiting messages once; owe the rest."""
        await self._collect()
        if self._pending and self._accepts:
            try:
                async with asyncio.timeout(LAST):
                    await self._send_live()
            except TimeoutError:
                self._account.count(f"{self._name}: last attempt given up")
        while self._pending:
            self._forgo(self._pending.popleft()[0], 1)
        # Without a single row in this start, the entries that an earlier start did not send are still owed.
        await self.cursor.write(ended=self._begun or self.cursor.position.ended)


class ForwardSettings(OutletSettings, Flow):
    """Settings of a forwarding outlet: derive your class and add the settings of your peer."""


F = TypeVar("F", bound=ForwardSettings)


class ForwardOutlet(Outlet[F], Peer[M], Generic[F, M]):
    """An outlet that only defines messages (``row``, ``result``) and how they are sent (``send``), see ``Peer``.

    The base class provides order, delivery at least once, back-fill beside new rows, limits, health, and an
    account whose residue is 0: expected = received + missed + owed.
    """

    def __init__(self, name: str, settings: F, view: CellView) -> None:
        super().__init__(name, settings, view)
        parts = framed_record(view), cursor_of(view, name, self.account, self.place), self.account
        self._forwarder: Forwarder[M] = Forwarder(name, self, settings, view.cell, *parts)

    @property
    def place(self) -> str:
        """Address of the peer. A changed address starts with nothing owed."""
        return ""

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[None]:
        """Hold open what ``send`` needs, such as a connection, while the outlet runs. Raises ``OutletError``."""
        yield

    def offer(self, item: Item) -> None:
        """Queue an item."""
        self._forwarder.offer(item)

    def succeed(self, before: Outlet[Any]) -> None:
        """Continue from the position of the previous outlet."""
        if isinstance(before, ForwardOutlet):
            self._forwarder.succeed(before._forwarder)

    def trouble(self) -> str | None:
        """Reason why the peer accepts nothing, or nothing can be back-filled."""
        return "; ".join(filter(None, self._forwarder.troubles)) or None

    async def run(self) -> None:
        """Send until cancelled, then once more."""
        async with self.opened():
            await self._forwarder.run()


def framed_record(view: CellView) -> Path | None:
    """Folder of the cell's record, if it holds frames."""
    folder = view.record_folder
    return None if folder is None or not view.config()["record"]["frames"] else folder


def cursor_of(view: CellView, name: str, account: Account, place: str = "") -> Cursor:
    """The cursor of an outlet, in a file beside the record; in memory only if the record has no frames."""
    record = framed_record(view)
    path = None if record is None else record / f"{plain_cell(view.cell)}.{plain_cell(name)}.json"
    return Cursor(path, account, place)
