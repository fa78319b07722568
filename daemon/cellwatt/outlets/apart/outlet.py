"""The daemon's side of an outlet that serves from a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, Final, TypeVar

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError, OutletError, ProtocolError
from cellwatt.frames import Frames, Layout
from cellwatt.outlet import CellView, Item, Outlet, OutletSettings
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.wire import Kind, end_of, running
from cellwatt.outlets.together import until_one_ends
from cellwatt.outlets.zenoh.messages import parse_json, topic_of
from cellwatt.processor import spent, starved
from cellwatt.results import Event, Result

log = logging.getLogger(__name__)

S = TypeVar("S", bound=OutletSettings)

BLOCKS: Final = 512
"""Blocks of frames that may wait for the process that serves."""
RESULTS: Final = 4096
"""Results and events that may wait for it."""
START: Final = 60.0
"""Longest time, s, for its start."""
SILENT: Final = 5.0
"""s without a sign of life after which it counts as stuck; one comes each second."""


class Apart(Outlet[S]):
    """Runs a process that serves strangers, so that nothing they do reaches the daemon, and answers its questions."""

    module: ClassVar[str]
    """Module that is the process."""
    what: ClassVar[str]
    """Its name in words, the subject of a sentence."""
    memory: ClassVar[int]
    """Bytes that the process may take; one that asks for more is made anew."""

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._heard: float | None = None
        self._process = 0
        self._spent = 0.0  # s of processor time, at its last sign of life
        self._counted: dict[str, int] = {}

    def hello(self) -> Mapping[str, Any]:
        """What the process is told first: its settings, of which cell, and where the record is."""
        about = {name: getattr(self.view, name) for name in ("site", "cell", "session", "record_folder")}
        return {"settings": self.settings, **about}

    @abstractmethod
    def answer(self, question: Mapping[str, Any]) -> Any:
        """Do or answer, JSON-ready, what the process asks. Raises ``CellwattError`` with the reason why not."""

    async def tell(self, writer: asyncio.StreamWriter) -> None:
        """Tell the process what the cell says, until cancelled."""
        await asyncio.get_running_loop().create_future()

    def starting(self) -> bool:
        """See ``Outlet.starting``."""
        return self._heard is None

    def trouble(self) -> str | None:
        """Reason why nothing moves, in words; ``None`` if all is well, or if it is not let run."""
        silent = 0.0 if self._heard is None else time.monotonic() - self._heard
        if silent <= SILENT or starved(self._process, self._spent, silent):
            return None
        return f"{self.what} says nothing for {silent:.0f} s"

    async def run(self) -> None:
        """Serve until cancelled. Raises ``OutletError`` with the reason if the process that serves ends."""
        async with running(self.module, self.what, self.memory) as (process, reader, writer):
            self._process = process.pid
            try:
                with contextlib.suppress(ConnectionError):  # it has ended
                    await self._serve(reader, writer)
            finally:
                self.url = self._heard = None
        raise OutletError(f"{self.what} ended ({end_of(process)})")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Tell the process all, and do what it orders, until it ends."""
        writer.write(wire.told(Kind.HELLO, self.hello()))
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
            raise OutletError(f"{self.what} ended while it began; its log says why")
        kind, body = got
        told = parse_json(body)
        if kind is Kind.FAILED:
            raise OutletError(told["error"])
        self.url, self._heard = told["url"], time.monotonic()
        log.info("%s is at %s", self.name, self.url)

    async def _listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer what the process asks, until it ends."""
        try:
            while (got := await wire.receive(reader)) is not None:
                kind, body = got
                told = parse_json(body)
                if kind is Kind.ORDER:
                    writer.write(wire.told(Kind.ANSWER, {"number": told["number"], **self._answered(told)}))
                    await writer.drain()
                elif kind is Kind.ALIVE:
                    self._heard, self._spent = time.monotonic(), spent(self._process)
                    self._count(told["counts"])
                elif kind is Kind.FAILED:
                    raise OutletError(told["error"])
        except (ProtocolError, KeyError, ValueError, TypeError, AttributeError) as error:
            raise OutletError(f"{self.what} speaks nonsense: {error}") from error

    def _answered(self, told: Mapping[str, Any]) -> dict[str, Any]:
        try:
            return {"error": None, "answer": self.answer(told)}
        except CellwattError as error:
            return {"error": str(error)}
        except Exception:  # never the end of what serves
            log.exception("%s: a question of its process", self.name)
            return {"error": "the daemon broke at it; its log says how"}

    def _count(self, counts: Mapping[str, int]) -> None:
        for what, number in counts.items():
            self.account.count(what, number - self._counted.get(what, 0))
        self._counted = dict(counts)


class ApartOutlet(Apart[S]):
    """Tells a process what the cell says, from bounded queues, and does what people order through it."""

    forgets: ClassVar[type[Result]]
    """Results of an earlier process that are not told again."""

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._blocks: deque[Frames] = deque()
        self._results: deque[Result | Event] = deque()
        self._status: Mapping[str, Any] | None = None
        self._fresh = asyncio.Event()
        self._told_once = False
        """The log has it that something could not be encoded."""

    def takes(self, item: Result | Event) -> bool:
        """True for a result or event that the process is told."""
        return True

    def offer(self, item: Item) -> None:
        """Queue one item; without room the oldest frames are dropped, results only beyond 4096 of them."""
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
        """Pass on the cell's health; the newest alone waits."""
        self._status = status
        self._fresh.set()

    def _past(self) -> list[Result | Event]:
        """What an earlier process was told and is to be known for longer, but for what still waits; blocks."""
        if self.view.journal is None:
            return []
        waiting = {repr(item) for item in list(self._results)}
        past = (item for _, item in self.view.journal.past() if self.takes(item) and not isinstance(item, self.forgets))
        return [item for item in past if repr(item) not in waiting]

    async def tell(self, writer: asyncio.StreamWriter) -> None:
        """Pass on what waits, and what comes."""
        for item in await asyncio.to_thread(self._past):
            self._pass(writer, 0, _item(item))
            await writer.drain()
        layout: Layout | None = None
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            while self._results or self._blocks or self._status is not None:
                if self._results:
                    self._pass(writer, 1, _item(self._results.popleft()))
                if self._blocks:
                    block = self._blocks.popleft()
                    head = [] if block.layout is layout else [(Kind.LAYOUT, block.layout)]
                    rows = block.sequence, block.time, block.values, block.quality, block.bound
                    if self._pass(writer, len(block), *head, (Kind.FRAMES, rows)):
                        layout = block.layout
                if self._status is not None and not self._results:  # it says how alarms stand after those
                    status, self._status = self._status, None
                    self._pass(writer, 0, (Kind.HEALTH, status))
                await writer.drain()

    def _pass(self, writer: asyncio.StreamWriter, count: int, *parts: tuple[Kind, Any]) -> bool:
        """Pass on what counts as so many; what cannot be encoded costs itself alone, and gives false."""
        try:
            data = b"".join(wire.told(kind, body) for kind, body in parts)
        except Exception:
            if not self._told_once:
                log.exception("%s: something cannot be encoded for its process, and is left out", self.name)
            self._told_once = True
            self._drop(count, "not encodable")
            if not count:  # health, or what an earlier process was told
                self.account.count("not encodable")
            return False
        writer.write(data)
        self.account.owed -= count
        self.account.receive(count)
        return True

    def answer(self, question: Mapping[str, Any]) -> None:
        """Do what a person orders."""
        alarm, name, note = question["alarm"], question["name"], question["note"]
        if question["what"] == "acknowledge":
            self.view.acknowledge(alarm, name, note)
        elif question["what"] == "shelve":
            self.view.shelve(alarm, question["until"], name, note)
        else:
            self.view.unshelve(alarm, name)
        self.account.count(f"{question['what']} by a person")


def _item(item: Result | Event) -> tuple[Kind, Any]:
    """A result or event as the first part of its topic and its fields."""
    body = {field.name: getattr(item, field.name) for field in fields(item)}
    return Kind.ITEM, (topic_of(item).partition("/")[0], body)
