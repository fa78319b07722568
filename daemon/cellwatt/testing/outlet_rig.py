"""What the outlet suite needs to know: the outlet, its settings, and a peer that the suite can make a bad one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from cellwatt.errors import OutletError
from cellwatt.outlet import CellView, Outlet

_MOST = 65536
_SLOW, _PAUSE = 512, 0.05
"""Bytes, and s between two of them, of a slow peer."""
State = Literal["well", "slow", "cut", "silent", "lies"]


class FarEnd(Protocol):
    """The other side, as its author writes it for the suite: it takes what the outlet sends, and remembers."""

    address: str
    """``host:port`` where it listens."""
    got: Sequence[int]
    """Times, UTC ns, of the rows that it has said to have, as they came."""
    refuse: bool
    """It is to refuse all for good."""


class Line:
    """A TCP relay to a peer that is ``well``, ``slow``, away (``cut``), ``silent``, or ``lies``: sends garbage."""

    def __init__(self, target: str) -> None:
        self.address = ""
        self._host, _, port = target.rpartition(":")
        self._port = int(port)
        self._state: State = "well"
        self._talking: set[asyncio.Task[None]] = set()

    def be(self, state: State) -> None:
        """Be that from now on; connections that are open end."""
        self._state = state
        for task in self._talking:
            task.cancel()

    async def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Relay one connection."""
        task = asyncio.current_task()
        assert task is not None
        self._talking.add(task)
        try:
            with suppress(OSError, asyncio.CancelledError):  # one end is gone: nobody awaits this task
                await self._talk(reader, writer)
        finally:
            self._talking.discard(task)
            writer.transport.abort()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._state in ("well", "slow"):
            at_once = _MOST if self._state == "well" else _SLOW
            up, down = await asyncio.open_connection(self._host, self._port)
            try:
                pumps = [
                    asyncio.ensure_future(pump) for pump in (_pump(reader, down, at_once), _pump(up, writer, at_once))
                ]
                try:
                    await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for pump in pumps:
                        pump.cancel()
                    await asyncio.gather(*pumps, return_exceptions=True)
            finally:
                down.transport.abort()
        while self._state in ("silent", "lies") and await reader.read(_MOST):
            if self._state == "lies":
                writer.write(bytes(range(256)))
                await writer.drain()
                return


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, at_once: int) -> None:
    while data := await reader.read(at_once):
        writer.write(data)
        await writer.drain()
        await asyncio.sleep(0.0 if at_once == _MOST else _PAUSE)


@asynccontextmanager
async def line_to(peer: FarEnd) -> AsyncIterator[Line]:
    """A line to a peer, well at first."""
    line = Line(peer.address)
    server = await asyncio.start_server(line.accept, "127.0.0.1", 0)
    line.address = f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
    try:
        yield line
    finally:
        server.close()
        line.be("cut")
        await asyncio.sleep(0.01)


@dataclass(frozen=True)
class OutletRig:
    """An ``outlet`` with ``settings``, and ``at``, which makes of an address the settings that say where it is.

    The settings ask for 10 rows a second, often, and for short waits.
    """

    outlet: type[Outlet[Any]]
    settings: Mapping[str, Any]
    peer: Callable[[], AbstractAsyncContextManager[FarEnd]]
    at: Callable[[str], Mapping[str, Any]]
    position: str = "*.peer.json"
    """Pattern of the file, beside the recordings, in which the outlet keeps its position."""
    patience: float = 60.0
    """s in which things must come."""

    def make(self, address: str, view: CellView) -> Outlet[Any]:
        """The outlet, called ``peer``."""
        return self.outlet("peer", self.outlet.Settings.model_validate({**self.settings, **self.at(address)}), view)


@dataclass
class RunningOutlet:
    """An outlet that runs as the daemon runs it: again when it raised ``OutletError``."""

    outlet: Outlet[Any]
    ends: list[str] = field(default_factory=list)

    async def supervise(self) -> None:
        """Run the outlet until cancelled."""
        while True:
            try:
                await self.outlet.run()
            except OutletError as error:
                self.ends.append(str(error))
            await asyncio.sleep(0.05)


@asynccontextmanager
async def running_outlet(outlet: Outlet[Any]) -> AsyncIterator[RunningOutlet]:
    """Run an outlet until the end of the context."""
    found = RunningOutlet(outlet)
    task = asyncio.create_task(found.supervise())
    try:
        yield found
    finally:
        task.cancel()
        await asyncio.wait([task])
        if not task.cancelled() and task.exception() is not None:
            task.result()
