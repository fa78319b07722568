"""TCP clients that are served and hung up on, or passed on to a server so that somebody sees what is said."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Final

Talk = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
See = Callable[[bytes], Awaitable[object]]

MOST: Final = 1 << 16
"""Bytes that are passed on at once."""


async def _at_once(_: bytes) -> None:
    return


@asynccontextmanager
async def clients(
    talk: Talk, host: str = "127.0.0.1", port: int = 0, tls: ssl.SSLContext | None = None
) -> AsyncIterator[tuple[str, set[asyncio.Task[None]]]]:
    """Take TCP clients at a port (0: any free one): its address, and the conversations, which may be cancelled.

    All of them are hung up on at the end. Raises ``OSError`` where the port cannot be opened.
    """
    talking: set[asyncio.Task[None]] = set()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        talking.add(task)
        try:
            await talk(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass  # one end is gone, sends what is no message, or is hung up on: nobody awaits this task
        finally:
            talking.discard(task)
            writer.close()

    server = await asyncio.start_server(accept, host, port, ssl=tls)
    try:
        host, port = server.sockets[0].getsockname()[:2]
        yield f"{host}:{port}", talking
    finally:
        server.close()
        for task in talking:
            task.cancel()
        await asyncio.gather(*talking, return_exceptions=True)
        await asyncio.sleep(0)  # closed transports let go of their sockets at the loop's next turn


async def pass_on(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, address: str, up: See = _at_once, down: See = _at_once
) -> None:
    """Pass on what a client and the server at ``address`` say until one of them leaves.

    ``up`` and ``down`` are awaited before what a client and what the server says goes on. Raises ``OSError`` where
    nobody is at the address.
    """
    host, _, port = address.rpartition(":")
    there, onward = await asyncio.open_connection(host, int(port))
    pumps = [asyncio.create_task(pump) for pump in (_pump(reader, onward, up), _pump(there, writer, down))]
    try:
        await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
    finally:
        onward.close()
        for pump in pumps:
            pump.cancel()
        await asyncio.gather(*pumps, return_exceptions=True)


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, see: See) -> None:
    while data := await reader.read(MOST):
        await see(data)
        writer.write(data)
        await writer.drain()
