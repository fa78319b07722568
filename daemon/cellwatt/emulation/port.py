"""Port of an emulated device, and the faults that strike its requests and responses."""

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
    """A port at which an emulator responds to requests of clients."""

    def __init__(self, emulator: Emulator) -> None:
        self._injector = emulator.injector
        self._tally = emulator.tally

    @abstractmethod
    async def __aenter__(self) -> str:
        """Open the port; return its real address. Raises ``OSError``."""

    @abstractmethod
    async def __aexit__(self, *_: object) -> None:
        """Disconnect all clients and close the port."""

    @abstractmethod
    def interrupt(self, seconds: float) -> None:
        """Disconnect all clients, and close the port for ``seconds`` s."""

    async def asked(self) -> None:
        """Handle a request: ``stall`` delays this call; ``disconnect`` hangs up, and this call never returns."""
        if outage := self._injector.once("disconnect"):
            self.interrupt(outage.seconds)
            await asyncio.Event().wait()
        if stall := self._injector.once("stall"):
            await asyncio.sleep(stall.seconds)

    async def answer(
        self, frame: bytes, write: Callable[[bytes], object], garbage: Callable[[bytes], bytes] = bytes
    ) -> None:
        """Write a response; it counts as ``made`` and, if whole, as ``sent``.

        Faults: ``loss``, ``half_frame`` (cut, then silence), ``delay``, and ``garbage``: random bytes before the
        response, which the function of that name makes fit for the wire.
        """
        self._tally["made"] += 1
        pieces, whole, late = self._injector.left_of(frame, lambda whole: len(whole) - 1, garbage)
        if late:
            await asyncio.sleep(late)
        for piece in pieces:
            write(piece)
        self._tally["sent"] += whole


class PortEmulator(Emulator):
    """An emulator with one ``port``, which ``set_up`` creates, and no other work."""

    faults: ClassVar[tuple[FaultKind, ...]] = ("delay", "loss", "garbage", "half_frame", "stall", "disconnect")
    port: Port

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with self.port as address:
            ready(address)
            await asyncio.Event().wait()


def host_and_port(address: str) -> tuple[str, int]:
    """Split ``HOST:PORT``. Raises ``ValueError`` for any other text."""
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdecimal() and int(port) < 1 << 16):
        raise ValueError(f"the address is HOST:PORT, like 127.0.0.1:30004, not {address!r}")
    return host, int(port)


class TcpPort(Port):
    """Accepts TCP clients at the emulator's address; ``talk`` serves each until it disconnects or is disconnected."""

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
        """See ``Port.interrupt``; no effect during an interruption."""
        if self._outage is None or self._outage.done():
            self._outage = asyncio.create_task(self._be_gone(seconds))

    async def _be_gone(self, seconds: float) -> None:
        await self._open_now.aclose()
        await asyncio.sleep(seconds)
        await self._open()

    async def _open(self) -> None:
        address, _ = await self._open_now.enter_async_context(clients(self._talk, *self._place, self._tls))
        self._place = host_and_port(address)
