"""The meter's side of the wire."""

from __future__ import annotations

import asyncio

from cellwatt.emulation import Options, PortEmulator, TcpPort
from cellwatt.testing.skeleton import wire


class SkeletonEmulator(PortEmulator):
    """A meter on ``supply.voltage``, ``.current`` and ``.power`` of its signals; listens on TCP.

    Faults on answers to ``READ?``: ``loss`` (not sent), ``half_frame`` (cut off), ``garbage`` (a line of random bytes
    before it), ``delay`` (late by ``seconds``). At the next request ``stall`` waits for ``seconds``; ``disconnect``
    closes the port for ``seconds``. ``made`` counts requests for a sample, ``sent`` whole answers.
    """

    title = "Skeleton meter"
    usual_address = f"127.0.0.1:{wire.PORT}"

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self.port = TcpPort(self, self._talk)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while question := await reader.readline():
            await self.port.asked()
            if question == wire.WHO:
                writer.write(b"METER,0001,1.0\n")
            elif question == wire.READ:
                await self.port.answer(wire.format_sample(self._sample()), writer.write, _line)

    def _sample(self) -> wire.Sample:
        now = self.world()
        return wire.Sample(*(now.get(f"supply.{name}", 0.0) for name in ("voltage", "current", "power")))


def _line(garbage: bytes) -> bytes:
    return garbage.replace(b"\n", b"\0") + b"\n"
