"""Port of an emulated device, and the faults that strike its questions and answers."""

from __future__ import annotations

import asyncio
import ssl
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import ClassVar

from cellwatt.emulation.emulator import Emulator
from cellwatt.emulation.faults import FaultKind
from cellwatt.emulation.relay import Talk, clients


class Port(ABC):
    """A port of an emulator at which clients ask and are answered."""

    def __init__(self, emulator: Emulator) -> None:
        self._injector = emulator.injector
        self._tally = emulator.tally

    @abstractmethod
    async def __aenter__(self) -> str:
        """Open it; the real address. Raises ``OSError``."""

    @abstractmethod
    async def __aexit__(self, *_: object) -> None:
        """Hang up on all clients and close it."""

    @abstractmethod
    def interrupt(self, seconds: float) -> None:
        """Hang up on all clients, and be gone for so long."""

    async def serve(self, ready: Callable[[str], None]) -> None:
        """As ``Emulator.serve``, where nothing else is to be done meanwhile."""
        async with self as address:
            ready(address)
            await asyncio.Event().wait()

    async def asked(self) -> None:
        """A question came: ``stall`` lets it wait, ``disconnect`` never return, as the asker is hung up on."""
        if outage := self._injector.once("disconnect"):
            self.interrupt(outage.seconds)
            await asyncio.Event().wait()
        if stall := self._injector.once("stall"):
            await asyncio.sleep(stall.seconds)

    async def answer(
        self, frame: bytes, write: Callable[[bytes], object], garbage: Callable[[bytes], bytes] = bytes
    ) -> None:
        """Write an answer, counted as ``made`` and, where it is whole, as ``sent``.

        ``loss`` and ``half_frame`` (cut, then silence) strike it, ``delay``, and ``garbage`` ahead of it: random bytes
        as the function of that name makes them fit for the wire.
        """
        self._tally["made"] += 1
        pieces, whole, late = self._injector.left_of(frame, _before_its_end, garbage)
        if late:
            await asyncio.sleep(late)
        for piece in pieces:
            write(piece)
        self._tally["sent"] += whole


def _before_its_end(frame: bytes) -> int:
    return len(frame) - 1


class PortEmulator(Emulator):
    """An emulator that answers at one ``port``, which ``set_up`` makes, and has nothing else to do."""

    faults: ClassVar[tuple[FaultKind, ...]] = ("delay", "loss", "garbage", "half_frame", "stall", "disconnect")
    port: Port

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        await self.port.serve(ready)


def host_and_port(address: str) -> tuple[str, int]:
    """Split ``HOST:PORT``. Raises ``ValueError`` for another text."""
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdecimal() and int(port) < 1 << 16):
        raise ValueError(f"the address is HOST:PORT, like 127.0.0.1:30004, not {address!r}")
    return host, int(port)


class TcpPort(Port):
    """Takes TCP clients at the emulator's address; ``talk`` serves each until it leaves or is hung up on."""

    def __init__(self, emulator: Emulator, talk: Talk, tls: ssl.SSLContext | None = None) -> None:
        super().__init__(emulator)
        self._place = host_and_port(emulator.address)
        self._talk = talk
        self._tls = tls
        self._open_now = AsyncExitStack()
        self._outage: asyncio.Task[None] | None = None

    async def __aenter__(self) -> str:
        """See ``Port``."""
        await self._open()
        return f"{self._place[0]}:{self._place[1]}"

    async def __aexit__(self, *_: object) -> None:
        """See ``Port``."""
        if self._outage is not None:
            self._outage.cancel()
            await asyncio.gather(self._outage, return_exceptions=True)
        await self._open_now.aclose()

    def interrupt(self, seconds: float) -> None:
        """See ``Port.interrupt``; one that lasts already goes on."""
        if self._outage is None or self._outage.done():
            self._outage = asyncio.create_task(self._be_gone(seconds))

    async def _be_gone(self, seconds: float) -> None:
        await self._open_now.aclose()
        await asyncio.sleep(seconds)
        await self._open()

    async def _open(self) -> None:
        address, _ = await self._open_now.enter_async_context(clients(self._talk, *self._place, self._tls))
        self._place = host_and_port(address)
