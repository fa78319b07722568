"""Servers that count the bytes they are sent: one that passes them on, and one that takes lines for InfluxDB."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

from aiohttp import web


@dataclass
class Counted:
    """A port of this host, and the bytes of TCP that came from its clients, and that went to them."""

    port: int = 0
    sent: int = 0
    received: int = 0


@asynccontextmanager
async def passing(port: int) -> AsyncIterator[Counted]:
    """A port whose connections are passed on to another one of this host."""
    counted = Counted()

    async def pipe(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, up: bool) -> None:
        with suppress(ConnectionError):
            while data := await reader.read(2**16):
                counted.sent += len(data) if up else 0
                counted.received += 0 if up else len(data)
                writer.write(data)
                await writer.drain()
        writer.close()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, out = await asyncio.open_connection("127.0.0.1", port)
        await asyncio.gather(pipe(reader, out, True), pipe(there, writer, False))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    counted.port = server.sockets[0].getsockname()[1]
    try:
        yield counted
    finally:
        server.close()


@asynccontextmanager
async def historian() -> AsyncIterator[Counted]:
    """An InfluxDB that takes everything and keeps nothing; counts bodies as they are sent, packed."""
    counted = Counted()

    async def take(request: web.BaseRequest) -> web.Response:
        counted.sent += request.content_length or 0
        await request.read()
        return web.Response(status=204)

    runner = web.ServerRunner(web.Server(take))
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    counted.port = runner.addresses[0][1]
    try:
        yield counted
    finally:
        await runner.cleanup()
