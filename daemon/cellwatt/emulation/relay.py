"""TCP clients, served by a function or relayed to a server whose traffic is observed."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Final

from cellwatt.together import until_one_ends

Talk = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
See = Callable[[bytes], Awaitable[object]]

MOST: Final = 1 << 16
"""Most bytes relayed at once."""


async def _at_once(_: bytes) -> None:
    return


@asynccontextmanager
async def clients(
    talk: Talk, host: str = "127.0.0.1", port: int = 0, tls: ssl.SSLContext | None = None
) -> AsyncIterator[tuple[str, set[asyncio.Task[None]]]]:
    """Accept TCP clients at a port (0: any free one); yields its address and the conversations' tasks.

    All clients are disconnected at the end; cancelling a task disconnects one. Raises ``OSError`` if the port cannot be
    opened.
    """
    talking: set[asyncio.Task[None]] = set()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        talking.add(task)
        try:
            await talk(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass  # a peer left, sent an invalid message or was disconnected: no caller awaits this task
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
        await asyncio.sleep(0)  # closed transports release their sockets at the loop's next turn


async def pass_on(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, address: str, up: See = _at_once, down: See = _at_once
) -> None:
    """Relay data between a client and the server at ``address`` until one of them disconnects.

    ``up`` and ``down`` are awaited before data of the client and of the server is relayed. Raises ``OSError`` if there
    is no server at the address.
    """
    host, _, port = address.rpartition(":")
    inward, onward = await asyncio.open_connection(host, int(port))
    try:
        await until_one_ends(_pump(reader, onward, up), _pump(inward, writer, down))
    finally:
        onward.close()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, see: See) -> None:
    while data := await reader.read(MOST):
        await see(data)
        writer.write(data)
        await writer.drain()
