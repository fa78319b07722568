"""Brings the rows and results of a cell to one peer, each at least once: what is new first, then what it missed."""

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
from typing import Any, Final, Generic, TypeVar

from pydantic import Field, PositiveInt

from cellwatt.account import Account
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet, OutletSettings
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.past import Archived, read
from cellwatt.outlets.remote import NotNowError
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.outlets.together import until_one_ends
from cellwatt.quantity import Seconds
from cellwatt.record.header import plain_cell
from cellwatt.record.messages import time_of
from cellwatt.results import Alarm, Energy, Task

log = logging.getLogger(__name__)

BLOCKS: Final = 2048
"""Items that may wait until they are put into messages."""
AT_ONCE: Final = 4
"""Items that are put into messages before the loop may turn to something else."""
MARGIN: Final = 60 * 10**9
"""ns in front of the last row sent which are filled in again after a kill: results come later than their time."""
SETTLED: Final = 3 * 10**9
"""ns after which all of a moment is in the record."""
ROWS: Final = 300
"""Rows that are filled in with one reading of the record."""
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0  # s
LAST: Final = 2.0
"""Longest time, s, of the last attempt when the outlet ends."""

M = TypeVar("M")


class Peer(ABC, Generic[M]):
    """What is particular to one kind of peer: how entries become messages, and how these are sent."""

    @abstractmethod
    def row(self, row: Row, units: Mapping[str, str]) -> M | None:
        """The message of a row; ``None`` where the peer has no use for it. Pure: called again for the past."""

    def result(self, result: Archived) -> M | None:
        """The message of an alarm, task or energy, or ``None``."""
        return None

    @abstractmethod
    async def send(self, messages: Sequence[M]) -> Mapping[str, int]:
        """Return once the peer has the messages, with the number of those that it refuses for good, by reason.

        Raises ``NotNowError`` where it takes nothing now: all of them are sent again.
        """


class Flow(Selection):
    """What goes to a peer, and how fast."""

    results: bool = True
    """Send alarms, tasks and energies, too."""
    batch: PositiveInt = Field(default=100, le=50_000)
    """Most messages of one attempt."""
    every: Seconds = Field(default=1.0, gt=0)
    """Time between two attempts while all is well."""
    queue: PositiveInt = 10_000
    """Messages that may wait; what is beyond is filled in from the record later."""


class Forwarder(Generic[M]):
    """The way to one peer, from what the cell offers and from its record.

    ``record`` is the folder of the record, ``None`` where there is none; ``name`` begins what is counted and said.
    """

    def __init__(
        self, name: str, peer: Peer[M], flow: Flow, cell: str, record: Path | None, cursor: Cursor, account: Account
    ) -> None:
        self.problem: str | None = None
        """Reason why nothing can be sent now; ``None`` if all is well."""
        self.unread: str | None = None
        """Reason why nothing can be filled in; ``None`` if all is well."""
        self.cursor = cursor
        self.unmatched: tuple[str, ...] = ()
        self._name, self._peer, self._cell, self._record, self._account = name, peer, cell, record, account
        self._flow = flow
        self._items: deque[Frames | Archived] = deque()
        self._pending: deque[tuple[int, M, bool]] = deque()
        """Times, UTC ns, messages, and whether these are rows."""
        self._picker: Picker | None = None
        self._begun = False
        self._newest = 0
        self._pause, self._not_before, self._fill_from = 0.0, 0.0, 0.0

    @property
    def troubles(self) -> Sequence[str | None]:
        """Reasons why something is not sent, or ``None``."""
        return self.problem, self.unread, self.cursor.problem

    def offer(self, item: Item) -> None:
        """Queue an item; beyond the room for them the oldest is filled in from the record later."""
        if (isinstance(item, Frames) and len(item)) or (self._flow.results and isinstance(item, Alarm | Task | Energy)):
            self._items.append(item)
            if len(self._items) > BLOCKS:
                self._forgo_item(self._items.popleft())

    def succeed(self, before: Forwarder[M]) -> None:
        """Go on where the one before ended, with what it was offered since."""
        self.cursor.succeed(before.cursor)
        self._items.extendleft(reversed(before._items))

    async def run(self) -> None:
        """Send until cancelled, then once more, and keep what is left to be filled in."""
        await self.cursor.open()
        try:
            await until_one_ends(self._serve(), self.cursor.keep())
        finally:
            await self._end()

    async def _serve(self) -> None:
        while True:
            await self._collect()
            ready = time.monotonic() >= self._not_before
            if ready and self._pending:
                await self._send_live()
            elif ready and (span := self._due()) is not None:
                await self._fill(*span)
            if not self._pending or time.monotonic() < self._not_before:
                filling = time.monotonic() >= self._not_before and self._due() is not None
                await asyncio.sleep(0.0 if filling else min(self._flow.every, 1.0))

    # what is new ----------------------------------------------------------------------------------

    async def _collect(self) -> None:
        """Put what was offered into messages, a few at a time: after an attempt that hung there are many."""
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
        picker = self._picker
        if picker is None or picker.layout != frames.layout:
            for row in () if picker is None else picker.rest():
                self._take_row(row)
            picker = self._picker = Picker(self._flow, frames.layout)
            self.unmatched = picker.unmatched
            if picker.unmatched:
                self._account.count(f"{self._name}: patterns that fit no channel", len(picker.unmatched))
                log.warning("%s: no channel fits %s", self._name, ", ".join(picker.unmatched))
        for row in picker.rows(frames):
            self._take_row(row)

    def _take_row(self, row: Row) -> None:
        assert self._picker is not None
        if self._record is not None and not self._begun:
            self._begin(row.time, self._picker.span)
        else:
            self._wait(row.time, self._peer.row(row, self._picker.units), True)
        self._begun = True

    def _wait(self, at: int, message: M | None, is_row: bool) -> None:
        if message is not None:
            self._pending.append((at, message, is_row))
            self._account.expect()
            self._account.owed += 1

    def _begin(self, first: int, span: int) -> None:
        """Leave the first row, of whose span we may have seen a part, and what came before it to the record."""
        reached = self.cursor.reached
        since = first - span if reached is None else reached if self.cursor.ended else reached - MARGIN
        self.cursor.owe(min(since, first - span), first)
        self.cursor.deliver(first)

    def _forgo_item(self, item: Frames | Archived) -> None:
        if isinstance(item, Frames):
            self._forgo(int(item.time[-1]), 0, int(item.time[0]) - self._span)
        else:
            self._forgo(time_of(item), 0)

    def _forgo(self, end: int, entries: int, start: int | None = None) -> None:
        """Leave what is not sent to the record, whole rows of it; without one it is lost."""
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
        return self._picker.span if self._picker is not None else round(1e9 / self._flow.rate)

    async def _send_live(self) -> None:
        batch = [self._pending.popleft() for _ in range(min(self._flow.batch, len(self._pending)))]
        sent = False
        try:
            sent = await self._send([message for _, message, _ in batch])
        finally:
            if not sent:
                self._pending.extendleft(reversed(batch))
        if sent:
            self._account.owed -= len(batch)
            # A result tells nothing of the rows before it: they may still be owed by an earlier start.
            for at in [at for at, _, is_row in batch if is_row][-1:]:
                self.cursor.deliver(at)

    # what was missed ------------------------------------------------------------------------------

    def _due(self) -> tuple[int, int] | None:
        """The next span that is to be filled in, as far as the record has it by now."""
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
            part = await asyncio.to_thread(work)
        except (CellwattError, OSError) as error:
            self._account.count(f"{self._name}: readings of the record that failed")
            self._fill_from = time.monotonic() + LONGEST_PAUSE
            reason = " ".join(str(error).split())
            self.unread = f"{self._name}: what was missed cannot be read from the record: {reason}"
            return
        self.unread = None
        found = [*((row.time, self._peer.row(row, part.units)) for row in part.rows)]
        found += [(time_of(result), self._peer.result(result)) for result in part.results]
        entries = sorted(((at, message) for at, message in found if message is not None), key=lambda e: e[0])
        sent = 0
        for first in range(0, len(entries), self._flow.batch):
            batch = entries[first : first + self._flow.batch]
            if not await self._send([message for _, message in batch]):
                return
            sent += len(batch)
            self._account.count(f"{self._name}: entries filled in", len(batch))
            left = entries[first + len(batch) :]
            until = (left[0][0] - 1) // self._span * self._span if left else part.until  # whole rows alone are read
            if until > after:  # at once: what is sent and what is paid go together
                self.cursor.pay(after, until, sent)
                after, sent = until, 0
            await self._collect()
            while self._pending and time.monotonic() >= self._not_before:  # what is new goes first
                await self._send_live()
        self.cursor.pay(after, part.until)
        if part.waits:
            self._fill_from = time.monotonic() + 1.0

    async def _send(self, messages: Sequence[M]) -> bool:
        """Send messages; false where the peer takes nothing now."""
        try:
            refused = await self._peer.send(messages)
        except NotNowError as error:
            self._account.count(f"{self._name}: attempts to be repeated")
            self._pause = min(max(2 * self._pause, FIRST_PAUSE), LONGEST_PAUSE)
            wait = self._pause if error.wait is None else error.wait
            self._not_before = time.monotonic() + wait
            self.problem = f"{self._name}: {error}; trying again in {wait:.1f} s"
            return False
        self._pause, self.problem = 0.0, None
        self._account.receive(len(messages) - sum(refused.values()))
        for reason, count in refused.items():
            self._account.miss(count, f"{self._name}: {reason}")
        return True

    async def _end(self) -> None:
        """Send what waits, once; leave the rest to the record."""
        await self._collect()
        if self._pending and time.monotonic() >= self._not_before:
            try:
                async with asyncio.timeout(LAST):
                    await self._send_live()
            except TimeoutError:
                self._account.count(f"{self._name}: last attempt given up")
        while self._pending:
            self._forgo(self._pending.popleft()[0], 1)
        # Where not even a row came, what an earlier start did not say is still to be said.
        await self.cursor.write(ended=self._begun or self.cursor.ended)


class ForwardSettings(OutletSettings, Flow):
    """Settings of an outlet that forwards: derive yours, and add what your peer needs."""


F = TypeVar("F", bound=ForwardSettings)


class ForwardOutlet(Outlet[F], Peer[M], Generic[F, M]):
    """An outlet that only says what a message is (``row``, ``result``) and how it is sent (``send``), see ``Peer``.

    It has what the record has: order, each at least once, what was missed beside what is new, limits, health, and an
    account whose residue is 0: expected = received + missed + owed.
    """

    def __init__(self, name: str, settings: F, view: CellView) -> None:
        super().__init__(name, settings, view)
        parts = framed_record(view), cursor_of(view, name, self.account, self.place), self.account
        self._forwarder: Forwarder[M] = Forwarder(name, self, settings, view.cell, *parts)

    @property
    def place(self) -> str:
        """The peer's address: to another one nothing that this one has is owed."""
        return ""

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[None]:
        """Hold what ``send`` needs, such as a connection, while the outlet runs. Raises ``OutletError``."""
        yield

    def offer(self, item: Item) -> None:
        """Queue an item."""
        self._forwarder.offer(item)

    def health(self, status: Mapping[str, Any]) -> None:
        """Nothing of it is sent."""

    def succeed(self, before: Outlet[Any]) -> None:
        """Go on where the outlet before ended."""
        if isinstance(before, ForwardOutlet):
            self._forwarder.succeed(before._forwarder)

    def trouble(self) -> str | None:
        """Reason why the peer takes nothing, or nothing can be filled in."""
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
    """The cursor of the outlet of that name, in a file beside the record; in memory alone where that has no frames."""
    record = framed_record(view)
    path = None if record is None else record / f"{plain_cell(view.cell)}.{plain_cell(name)}.json"
    return Cursor(path, account, place)
