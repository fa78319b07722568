"""The process that serves a cell over OPC UA: ``python -m cellwatt.sinks.opc_ua.serving DESCRIPTOR``."""

from __future__ import annotations

import asyncio
import itertools
import logging
import signal
import socket
import sys
from typing import Final

from cellwatt.errors import ProtocolError
from cellwatt.sinks.apart import LIMIT
from cellwatt.sinks.opc_ua.served import CellServer, quiet
from cellwatt.sinks.opc_ua.wire import message, received

log = logging.getLogger(__name__)

_ALIVE: Final = 1.0
"""s between two signs of life."""
_PATIENCE: Final = 10.0
"""s that an acknowledgement may take."""


class Serving:
    """One server, and the socket by which it is told what the cell says."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self._numbers = itertools.count(1)
        self._asked: dict[int, asyncio.Future[str | None]] = {}

    async def run(self) -> None:
        """Serve until the socket is closed."""
        got = await received(self._reader)
        if got is None or got[0] != "hello":
            return
        server = CellServer(got[1], self._order)
        try:
            url = await server.open()
        except (OSError, ValueError) as error:
            told = getattr(error, "strerror", None) or str(error)
            self._writer.write(message("failed", {"error": f"the OPC UA server cannot listen or be made: {told}"}))
            await self._writer.drain()
            return
        self._writer.write(message("ready", {"url": url}))
        living = asyncio.create_task(self._live())
        try:
            await self._hear(server)
        finally:
            living.cancel()
            await server.close()

    async def _hear(self, server: CellServer) -> None:
        told = {name: getattr(server, name) for name in ("layout", "row", "alarm", "acknowledged", "energy", "health")}
        while (got := await received(self._reader)) is not None:
            kind, content = got
            if kind == "answer":
                asked = self._asked.pop(content["number"], None)
                if asked is not None and not asked.done():
                    asked.set_result(content["error"])
            elif kind in told:
                await told[kind](content)
            else:
                raise ProtocolError(f"nothing is known of {kind!r}")

    async def _live(self) -> None:
        while True:
            self._writer.write(message("alive", {}))
            await self._writer.drain()
            await asyncio.sleep(_ALIVE)

    async def _order(self, alarm: str, name: str, note: str) -> str | None:
        """Have an alarm acknowledged by the daemon; return why not."""
        number = next(self._numbers)
        asked: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()
        self._asked[number] = asked
        self._writer.write(message("acknowledge", {"number": number, "alarm": alarm, "name": name, "note": note}))
        try:
            async with asyncio.timeout(_PATIENCE):
                return await asked
        except TimeoutError:
            return "no answer from the daemon"
        finally:
            self._asked.pop(number, None)


async def serve(descriptor: int) -> None:
    """Serve what is told through a socket, until it is closed."""
    with socket.socket(fileno=descriptor) as end:
        reader, writer = await asyncio.open_connection(sock=end, limit=LIMIT)
        try:
            await Serving(reader, writer).run()
        finally:
            writer.close()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a key pressed in a terminal is the daemon's affair
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s opc_ua: %(message)s")
    quiet()
    asyncio.run(serve(int(sys.argv[1])))
