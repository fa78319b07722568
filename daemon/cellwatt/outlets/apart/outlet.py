"""The daemon's side of an outlet that serves from a separate process."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar, Final, TypeVar

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError, OutletError, ProtocolError
from cellwatt.frames import Frames, Layout
from cellwatt.outlet import CellView, Item, Outlet, OutletSettings
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.wire import Kind, end_of, running
from cellwatt.outlets.zenoh.messages import parse_json
from cellwatt.processor import spent, starved
from cellwatt.results import Event, Result
from cellwatt.together import until_one_ends

log = logging.getLogger(__name__)

S = TypeVar("S", bound=OutletSettings)

BLOCKS: Final = 512
"""Most blocks of frames that wait for the serving process."""
RESULTS: Final = 4096
"""Most results and events that wait for it."""
START: Final = 60.0
"""Longest time, s, until the process is ready."""
SILENT: Final = 5.0
"""Time without a heartbeat, s, after which the process counts as stuck; one is due each second."""


class Apart(Outlet[S]):
    """Runs a process that serves clients, so that they cannot affect the daemon, and answers its questions."""

    module: ClassVar[str]
    """Module that the process runs."""
    what: ClassVar[str]
    """Name of the process in messages, the subject of a sentence."""
    memory: ClassVar[int]
    """Most bytes of memory of the process; one that needs more ends and is restarted."""

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._heard: float | None = None
        self._process = 0
        self._spent = 0.0  # s of processor time, at its last sign of life
        self._counted: dict[str, int] = {}

    def hello(self) -> Mapping[str, Any]:
        """First message to the process: settings, cell and folder of the record."""
        about = {name: getattr(self.view, name) for name in ("site", "cell", "session", "record_folder")}
        return {"settings": self.settings, **about}

    @abstractmethod
    def answer(self, question: Mapping[str, Any]) -> Any:
        """Execute an order of the process; return a JSON-ready answer. Raises ``CellwattError`` with the reason."""

    async def tell(self, writer: asyncio.StreamWriter) -> None:
        """Send the cell's data to the process, until cancelled."""
        await asyncio.get_running_loop().create_future()

    def starting(self) -> bool:
        """See ``Outlet.starting``."""
        return self._heard is None

    def trouble(self) -> str | None:
        """Reason why the process does not serve; ``None`` if it does, or if it gets no processor time."""
        silent = 0.0 if self._heard is None else time.monotonic() - self._heard
        if silent <= SILENT or starved(self._process, self._spent, silent):
            return None
        return f"{self.what} has not responded for {silent:.0f} s"

    async def run(self) -> None:
        """Serve until cancelled. Raises ``OutletError`` with the reason if the serving process ends."""
        async with running(self.module, self.what, self.memory) as (process, reader, writer):
            self._process = process.pid
            try:
                with contextlib.suppress(ConnectionError):  # the process has ended
                    await self._serve(reader, writer)
            finally:
                self.url = self._heard = None
        raise OutletError(f"{self.what} ended ({end_of(process)})")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Send data to the process and execute its orders, until it ends."""
        writer.write(wire.from_daemon(Kind.HELLO, self.hello()))
        await self._until_ready(reader)
        self._counted = {}
        await until_one_ends(self.tell(writer), self._listen(reader, writer))

    async def _until_ready(self, reader: asyncio.StreamReader) -> None:
        try:
            async with asyncio.timeout(START):
                got = await wire.receive(reader)
        except TimeoutError:
            raise OutletError(f"{self.what} is not ready after {START:.0f} s") from None
        if got is None:
            raise OutletError(f"{self.what} ended during its start; see its log for the reason")
        kind, body = got
        reply = parse_json(body)
        if kind is Kind.FAILED:
            raise OutletError(reply["error"])
        self.url, self._heard = reply["url"], time.monotonic()
        log.info("%s is at %s", self.name, self.url)

    async def _listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer the messages of the process, until it ends."""
        try:
            while (got := await wire.receive(reader)) is not None:
                kind, body = got
                reply = parse_json(body)
                if kind is Kind.ORDER:
                    writer.write(wire.from_daemon(Kind.ANSWER, {"number": reply["number"], **self._answered(reply)}))
                    await writer.drain()
                elif kind is Kind.ALIVE:
                    self._heard, self._spent = time.monotonic(), spent(self._process)
                    self._count(reply["counts"])
                elif kind is Kind.FAILED:
                    raise OutletError(reply["error"])
        except (ProtocolError, KeyError, ValueError, TypeError, AttributeError) as error:
            raise OutletError(f"{self.what} sent an invalid message: {error}") from error

    def _answered(self, reply: Mapping[str, Any]) -> dict[str, Any]:
        try:
            return {"error": None, "answer": self.answer(reply)}
        except CellwattError as error:
            return {"error": str(error)}
        except Exception:  # must not end the outlet
            log.exception("%s: an order of its process failed", self.name)
            return {"error": "the daemon failed to execute it; see its log"}

    def _count(self, counts: Mapping[str, int]) -> None:
        for what, number in counts.items():
            self.account.count(what, number - self._counted.get(what, 0))
        self._counted = dict(counts)


class ApartOutlet(Apart[S]):
    """Sends the cell's data to a process, from bounded queues, and executes people's orders received by it."""

    forgets: ClassVar[type[Result]]
    """Type of results that are not sent again to a restarted process."""

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._blocks: deque[Frames] = deque()
        self._results: deque[Result | Event] = deque()
        self._status: Mapping[str, Any] | None = None
        self._fresh = asyncio.Event()
        self._logged = False
        """True once the log has a message that could not be encoded."""

    def takes(self, item: Result | Event) -> bool:
        """True for a result or event that is sent to the process."""
        return True

    def offer(self, item: Item) -> None:
        """Queue one item; full queues drop their oldest block of frames, or oldest result."""
        if isinstance(item, Batch):
            return
        if isinstance(item, Frames):
            self._wait(len(item))
            self._blocks.append(item)
            if len(self._blocks) > BLOCKS:
                self._drop(len(self._blocks.popleft()), "queue: frames")
        elif self.takes(item):
            self._wait(1)
            self._results.append(item)
            if len(self._results) > RESULTS:
                self._results.popleft()
                self._drop(1, "queue: results")
        self._fresh.set()

    def _wait(self, count: int) -> None:
        self.account.expect(count)
        self.account.owed += count

    def _drop(self, count: int, where: str) -> None:
        self.account.owed -= count
        self.account.drop(count, where)

    def health(self, status: Mapping[str, Any]) -> None:
        """Queue the cell's health; only the newest waits."""
        self._status = status
        self._fresh.set()

    def _past(self) -> list[Result | Event]:
        """Results and events for a restarted process, without those that still wait; blocks."""
        if self.view.journal is None:
            return []
        past = [item for _, item in self.view.journal.past() if self.takes(item) and not isinstance(item, self.forgets)]
        waiting = {repr(item) for item in list(self._results)}  # also those offered during the reading
        return [item for item in past if repr(item) not in waiting]

    async def tell(self, writer: asyncio.StreamWriter) -> None:
        """Send past, waiting and new items, until cancelled."""
        for item in await asyncio.to_thread(self._past):
            self._pass(writer, 0, (Kind.ITEM, item))
            await writer.drain()
        layout: Layout | None = None
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            while self._results or self._blocks or self._status is not None:
                if self._results:
                    self._pass(writer, 1, (Kind.ITEM, self._results.popleft()))
                if self._blocks:
                    block = self._blocks.popleft()
                    head = [] if block.layout is layout else [(Kind.LAYOUT, block.layout)]
                    rows = block.sequence, block.time, block.values, block.quality, block.bound
                    if self._pass(writer, len(block), *head, (Kind.FRAMES, rows)):
                        layout = block.layout
                if self._status is not None and not self._results:  # it contains the alarms' state after these results
                    status, self._status = self._status, None
                    self._pass(writer, 0, (Kind.HEALTH, status))
                await writer.drain()

    def _pass(self, writer: asyncio.StreamWriter, count: int, *parts: tuple[Kind, Any]) -> bool:
        """Send messages that count as ``count`` items; false, and counted as dropped, if they cannot be encoded."""
        try:
            data = b"".join(wire.from_daemon(kind, body) for kind, body in parts)
        except Exception:
            if not self._logged:
                log.exception("%s: an item cannot be encoded for its process, and is dropped", self.name)
            self._logged = True
            self._drop(count, "not encodable")
            if not count:  # health, or items that an earlier process received
                self.account.count("not encodable")
            return False
        writer.write(data)
        self.account.owed -= count
        self.account.receive(count)
        return True

    def answer(self, question: Mapping[str, Any]) -> None:
        """Execute a person's order."""
        alarm, name, note = question["alarm"], question["name"], question["note"]
        if question["what"] == "acknowledge":
            self.view.acknowledge(alarm, name, note)
        elif question["what"] == "shelve":
            self.view.shelve(alarm, question["until"], name, note)
        else:
            self.view.unshelve(alarm, name)
        self.account.count(f"{question['what']} by a person")
