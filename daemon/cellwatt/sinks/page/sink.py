"""Starts the process that serves a cell's page, and tells it what the cell says."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import find_spec
from typing import Any, ClassVar, Final

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError, ProtocolError, SinkError
from cellwatt.frames import Frames, Layout
from cellwatt.publish.messages import parse_json
from cellwatt.results import Event, Prediction, Result
from cellwatt.sink import CellView, Item, Sink
from cellwatt.sinks.apart import begin, end_of, ending
from cellwatt.sinks.page import wire
from cellwatt.sinks.page.settings import PageSettings
from cellwatt.sinks.page.wire import Kind

if find_spec("aiohttp") is None:  # only the process that serves imports it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")

log = logging.getLogger(__name__)

MODULE: Final = "cellwatt.sinks.page.serving"
BLOCKS: Final = 512
"""Blocks of frames that may wait for the process that serves."""
RESULTS: Final = 4096
"""Results and events that may wait for it."""
START: Final = 60.0
"""Longest time, s, for its start."""
SILENT: Final = 5.0
"""s without a sign of life after which it counts as stuck; one comes each second."""


class PageSink(Sink[PageSettings]):
    """Shows a cell in a browser.

    A process of its own serves, so that no browser holds up what the daemon does; frames, results, events and health
    are put into a queue for it. What it is told beside them are the settings, and what comes back are orders of people.
    """

    Settings: ClassVar[type[PageSettings]] = PageSettings
    title = "The cell in a browser: live, its past, its alarms to acknowledge"

    def __init__(self, name: str, settings: PageSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._blocks: deque[Frames] = deque()
        self._results: deque[Result | Event] = deque()
        self._status: Mapping[str, Any] | None = None
        self._fresh = asyncio.Event()
        self._heard: float | None = None
        self._counted: dict[str, int] = {}

    def offer(self, item: Item) -> None:
        """Queue one item; without room the oldest frames are dropped, results only beyond 4096 of them."""
        if isinstance(item, Batch):
            return
        if isinstance(item, Frames):
            self.account.expect(len(item))
            self._blocks.append(item)
            if len(self._blocks) > BLOCKS:
                self.account.drop(len(self._blocks.popleft()), "queue: frames")
        else:
            self.account.expect()
            self._results.append(item)
            if len(self._results) > RESULTS:
                self._results.popleft()
                self.account.drop(1, "queue: results")
        self._fresh.set()

    def health(self, status: Mapping[str, Any]) -> None:
        """Pass on the cell's health; the newest alone waits."""
        self._status = status
        self._fresh.set()

    def trouble(self) -> str | None:
        """Reason why the page does not move, in words; ``None`` if it does."""
        silent = 0.0 if self._heard is None else time.monotonic() - self._heard
        return f"the process that serves the page says nothing for {silent:.0f} s" if silent > SILENT else None

    async def run(self) -> None:
        """Serve until cancelled. Raises ``SinkError`` with the reason if the process that serves ends."""
        process, reader, writer = await begin(MODULE, "the process that serves the page")
        async with ending(process, writer):
            try:
                with contextlib.suppress(ConnectionError):  # it has ended
                    await self._serve(reader, writer)
            finally:
                self.url = self._heard = None
        raise SinkError(f"the process that serves the page ended ({end_of(process)})")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Tell the process all, and do what it orders, until it ends."""
        writer.write(wire.json_message(Kind.HELLO, self._hello()))
        await self._until_ready(reader)
        for item in await asyncio.to_thread(self._past):
            writer.write(wire.item(item))
            await writer.drain()
        tasks = [asyncio.create_task(self._tell(writer)), asyncio.create_task(self._listen(reader, writer))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # the beginning --------------------------------------------------------------------------------

    def _hello(self) -> dict[str, Any]:
        view = self.view
        return {
            "settings": self.settings.told(),
            "site": view.site,
            "cell": view.cell,
            "session": view.session,
            "record": None if view.record_folder is None else str(view.record_folder),
        }

    def _past(self) -> list[Result | Event]:
        """What an earlier process was told, but for predictions and what is still to be told; blocks."""
        if self.view.journal is None:
            return []
        waiting = {repr(item) for item in list(self._results)}
        past = (item for _, item in self.view.journal.past() if not isinstance(item, Prediction))
        return [item for item in past if repr(item) not in waiting]

    async def _until_ready(self, reader: asyncio.StreamReader) -> None:
        try:
            async with asyncio.timeout(START):
                got = await wire.receive(reader)
        except TimeoutError:
            raise SinkError(f"the process that serves the page is not ready after {START:.0f} s") from None
        if got is None:
            raise SinkError("the process that serves the page ended while it began; its log says why")
        kind, body = got
        told = parse_json(body)
        if kind is Kind.FAILED:
            raise SinkError(told["error"])
        self.url, self._heard = told["url"], time.monotonic()
        log.info("the page is at %s", self.url)

    # both ways ------------------------------------------------------------------------------------

    async def _tell(self, writer: asyncio.StreamWriter) -> None:
        """Pass on what waits, and what comes."""
        layout: Layout | None = None
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            while self._results or self._blocks or self._status is not None:
                if self._results:
                    item = self._results.popleft()
                    self._put(writer, 1, partial(wire.item, item))
                if self._blocks:
                    block = self._blocks.popleft()
                    if block.layout is not layout:
                        layout = block.layout
                        writer.write(wire.layout(layout))
                    self._put(writer, len(block), partial(wire.frames, block))
                if self._status is not None:
                    status, self._status = self._status, None
                    writer.write(wire.json_message(Kind.HEALTH, status))
                await writer.drain()

    def _put(self, writer: asyncio.StreamWriter, count: int, encode: Callable[[], bytes]) -> None:
        """Write an item of ``count`` samples; one that cannot be encoded costs only itself."""
        try:
            writer.write(encode())
        except (TypeError, ValueError, AttributeError):
            self.account.drop(count, "not encodable")
            log.exception("an item cannot be told to the page")
        else:
            self.account.receive(count)

    async def _listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Do what people order through the page, until the process ends."""
        try:
            while (got := await wire.receive(reader)) is not None:
                kind, body = got
                self._heard = time.monotonic()
                told = parse_json(body)
                if kind is Kind.ORDER:
                    answer = {"number": told["number"], "error": self._do(told)}
                    writer.write(wire.json_message(Kind.ANSWER, answer))
                elif kind is Kind.ALIVE:
                    self._count(told["counts"])
                elif kind is Kind.FAILED:
                    raise SinkError(told["error"])
        except (ProtocolError, KeyError, ValueError) as error:
            raise SinkError(f"the process that serves the page speaks nonsense: {error}") from error

    def _do(self, order: Mapping[str, Any]) -> str | None:
        """Do what a person orders; return why not."""
        alarm, name, note = order["alarm"], order["name"], order["note"]
        try:
            if order["what"] == "acknowledge":
                self.view.acknowledge(alarm, name, note)
            elif order["what"] == "shelve":
                self.view.shelve(alarm, order["until"], name, note)
            else:
                self.view.unshelve(alarm, name)
        except CellwattError as error:
            return str(error)
        except Exception:  # never the end of the page
            log.exception("%s of alarm %s by %s", order["what"], alarm, name)
            return "the daemon broke at it; its log says how"
        self.account.count(f"{order['what']} by a person")
        return None

    def _count(self, counts: Mapping[str, int]) -> None:
        for what, number in counts.items():
            self.account.count(what, number - self._counted.get(what, 0))
        self._counted = dict(counts)
