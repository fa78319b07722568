"""Starts the process that serves a cell over OPC UA, and tells it what the cell says."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any, ClassVar, Final

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError, ProtocolError, SinkError
from cellwatt.frames import Frames
from cellwatt.results import Alarm, Energy, Event
from cellwatt.sink import CellView, Item, Sink
from cellwatt.sinks.apart import begin, end_of, ending
from cellwatt.sinks.opc_ua.settings import OpcUaSinkSettings
from cellwatt.sinks.opc_ua.wire import message, received
from cellwatt.sinks.selection import Picker, Row

if find_spec("asyncua") is None:  # only the process that serves imports it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'asyncua'", name="asyncua")

log = logging.getLogger(__name__)

MODULE: Final = "cellwatt.sinks.opc_ua.serving"
BLOCKS: Final = 512
"""Blocks of frames that may wait for the process that serves."""
RESULTS: Final = 4096
"""Alarms, words about them and energies that may wait for it."""
START: Final = 60.0
"""Longest time, s, for its start."""
SILENT: Final = 5.0
"""s without a sign of life after which it counts as stuck; one comes each second."""
_ACKNOWLEDGED: Final = "acknowledged"


class OpcUaSink(Sink[OpcUaSinkSettings]):
    """Serves a cell's values, energies, health and alarms to OPC UA clients, from a process of its own."""

    Settings: ClassVar[type[OpcUaSinkSettings]] = OpcUaSinkSettings
    title = "The cell as an OPC UA server, with the types of OPC UA for Robotics"

    def __init__(self, name: str, settings: OpcUaSinkSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._blocks: deque[Frames] = deque()
        self._results: deque[tuple[str, dict[str, Any]]] = deque()
        self._status: Mapping[str, Any] | None = None
        self._fresh = asyncio.Event()
        self._heard: float | None = None
        self._picker: Picker | None = None

    def offer(self, item: Item) -> None:
        """Queue frames, alarms, words about alarms and energies; without room the oldest are dropped and counted."""
        if isinstance(item, Batch):
            return
        if isinstance(item, Frames):
            self.account.expect(len(item))
            self._blocks.append(item)
            if len(self._blocks) > BLOCKS:
                self.account.drop(len(self._blocks.popleft()), "queue: frames")
        elif (told := _told(item)) is not None:
            self.account.expect()
            self._results.append(told)
            if len(self._results) > RESULTS:
                self._results.popleft()
                self.account.drop(1, "queue: results")
        else:
            return
        self._fresh.set()

    def health(self, status: Mapping[str, Any]) -> None:
        """Pass on the cell's health; the newest alone waits."""
        self._status = status
        self._fresh.set()

    def trouble(self) -> str | None:
        """Reason why the server does not serve, in words; ``None`` if it does."""
        silent = 0.0 if self._heard is None else time.monotonic() - self._heard
        return f"the OPC UA server says nothing for {silent:.0f} s" if silent > SILENT else None

    async def run(self) -> None:
        """Serve until cancelled. Raises ``SinkError`` with the reason if the process that serves ends."""
        process, reader, writer = await begin(MODULE, "the OPC UA server")
        async with ending(process, writer):
            try:
                with contextlib.suppress(ConnectionError):  # it has ended
                    await self._serve(reader, writer)
            finally:
                self.url = self._heard = self._picker = None
        raise SinkError(f"the OPC UA server ended ({end_of(process)})")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        view = self.view
        writer.write(message("hello", {**self.settings.told(), "site": view.site, "cell": view.cell}))
        await self._until_ready(reader)
        for kind, content in await asyncio.to_thread(self._past):
            writer.write(message(kind, content))
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

    def _past(self) -> list[tuple[str, dict[str, Any]]]:
        """Alarms and words about them that an earlier process was told; blocks."""
        if self.view.journal is None:
            return []
        told = (_told(item) for _, item in self.view.journal.past())
        return [one for one in told if one is not None and one[0] != "energy" and one not in self._results]

    async def _until_ready(self, reader: asyncio.StreamReader) -> None:
        try:
            async with asyncio.timeout(START):
                got = await received(reader)
        except TimeoutError:
            raise SinkError(f"the OPC UA server is not ready after {START:.0f} s") from None
        if got is None:
            raise SinkError("the OPC UA server ended while it began; its log says why")
        if got[0] == "failed":
            raise SinkError(str(got[1]["error"]))
        self.url, self._heard = str(got[1]["url"]), time.monotonic()
        log.info("the OPC UA server is at %s", self.url)

    async def _tell(self, writer: asyncio.StreamWriter) -> None:
        """Pass on what waits, and what comes."""
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            while self._results or self._blocks or self._status is not None:
                if self._results:
                    writer.write(message(*self._results.popleft()))
                    self.account.receive()
                if self._blocks:
                    self._tell_rows(writer, self._blocks.popleft())
                if self._status is not None:
                    status, self._status = self._status, None
                    writer.write(message("health", {"text": json.dumps(status, default=str)}))
                await writer.drain()

    def _tell_rows(self, writer: asyncio.StreamWriter, block: Frames) -> None:
        if self._picker is None or self._picker.layout is not block.layout:
            self._picker = picker = Picker(self.settings, block.layout)
            kinds = {c.name: c.kind for c in block.layout.channels}
            channels = [{"name": n, "unit": unit, "kind": kinds[n]} for n, unit in picker.units.items()]
            writer.write(message("layout", {"channels": channels}))
        for row in self._picker.rows(block):
            writer.write(message("row", _row(row)))
        self.account.receive(len(block))

    async def _listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Do what people acknowledge over OPC UA, until the process ends."""
        try:
            while (got := await received(reader)) is not None:
                kind, told = got
                self._heard = time.monotonic()
                if kind == "acknowledge":
                    writer.write(message("answer", {"number": told["number"], "error": self._acknowledge(told)}))
                elif kind == "failed":
                    raise SinkError(str(told["error"]))
        except (ProtocolError, KeyError) as error:
            raise SinkError(f"the process that serves over OPC UA speaks nonsense: {error}") from error

    def _acknowledge(self, order: Mapping[str, Any]) -> str | None:
        """Acknowledge an alarm; return why not."""
        try:
            self.view.acknowledge(order["alarm"], order["name"], order["note"])
        except CellwattError as error:
            return str(error)
        self.account.count("acknowledged by a person")
        return None


def _told(item: Item) -> tuple[str, dict[str, Any]] | None:
    """Return what the server is told of an item; ``None`` for one that it has no node for."""
    if isinstance(item, Alarm):
        told = asdict(item)
        return "alarm", {key: told[key] for key in _OF_ALARM}
    if isinstance(item, Event) and item.kind == _ACKNOWLEDGED:
        return "acknowledged", {"alarm": item.data["alarm"], "name": item.data["name"], "note": item.data["note"]}
    if isinstance(item, Energy):
        return "energy", {"source": item.source, "task": item.task, "total": item.total, "end": item.end}
    return None


_OF_ALARM: Final = ("id", "kind", "severity", "active", "since", "time", "statement", "source")


def _row(row: Row) -> dict[str, Any]:
    values = {name: value for name, value in row.values.items() if math.isfinite(value)}
    return {"time": row.time, "values": values, "quality": row.quality}
