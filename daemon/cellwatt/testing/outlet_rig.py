"""Description of an outlet for the suite: the outlet, its settings, and a peer that the suite can make faulty."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from cellwatt.emulation.relay import MOST, clients, pass_on
from cellwatt.errors import OutletError
from cellwatt.outlet import CellView, Outlet

State = Literal["well", "cut", "silent", "lies"]


class FarEnd(Protocol):
    """The peer, written by the outlet's author: it receives and stores the outlet's rows."""

    address: str
    """``host:port`` at which it listens."""
    got: Sequence[int]
    """Times, UTC ns, of the rows that it has acknowledged, in order of arrival."""
    refuse: bool
    """Refuse every row permanently."""


class Line:
    """A TCP relay to a peer that is ``well``, disconnected (``cut``), ``silent``, or ``lies``: sends garbage."""

    def __init__(self, target: str) -> None:
        self.address = ""
        self.talking: set[asyncio.Task[None]] = set()
        self._target = target
        self._state: State = "well"

    def be(self, state: State) -> None:
        """Change to this state; open connections end."""
        self._state = state
        for task in self.talking:
            task.cancel()

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        if self._state == "well":
            await pass_on(reader, writer, self._target)
        while self._state in ("silent", "lies") and await reader.read(MOST):
            if self._state == "lies":
                writer.write(bytes(range(256)))
                await writer.drain()
                return


@asynccontextmanager
async def line_to(peer: FarEnd) -> AsyncIterator[Line]:
    """A line to a peer, initially ``well``."""
    line = Line(peer.address)
    async with clients(line.talk) as (line.address, line.talking):
        yield line


@dataclass(frozen=True)
class OutletRig:
    """An ``outlet`` with ``settings``, and ``at``, which converts an address to the settings that contain it.

    The settings should have 10 rows a second, frequent sending and short waits.
    """

    outlet: type[Outlet[Any]]
    settings: Mapping[str, Any]
    peer: Callable[[], AbstractAsyncContextManager[FarEnd]]
    at: Callable[[str], Mapping[str, Any]]
    position: str = "*.peer.json"
    """Pattern of the file, beside the recordings, in which the outlet stores its position."""
    patience: float = 60.0
    """Time limit, s, for anything awaited."""

    def make(self, address: str, view: CellView) -> Outlet[Any]:
        """Create the outlet, named ``peer``."""
        return self.outlet("peer", self.outlet.Settings.model_validate({**self.settings, **self.at(address)}), view)


@asynccontextmanager
async def running_outlet(outlet: Outlet[Any]) -> AsyncIterator[list[str]]:
    """Run an outlet as the daemon does, again after each ``OutletError``, whose texts are yielded."""
    ends: list[str] = []

    async def supervise() -> None:
        while True:
            try:
                await outlet.run()
            except OutletError as error:
                ends.append(str(error))
            await asyncio.sleep(0.05)

    task = asyncio.create_task(supervise())
    try:
        yield ends
    finally:
        task.cancel()
        await asyncio.wait([task])
        if not task.cancelled() and task.exception() is not None:
            task.result()
