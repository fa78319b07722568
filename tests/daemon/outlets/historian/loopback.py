"""A fake of an HTTP server, listening on loopback."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Self

from aiohttp import web


@dataclass
class Loopback:
    """Answers by ``take``, at ``url`` while it is ``open``."""

    url: str = ""

    async def take(self, request: web.BaseRequest) -> web.Response:
        raise NotImplementedError

    @asynccontextmanager
    async def open(self) -> AsyncIterator[Self]:
        runner = web.ServerRunner(web.Server(self.take))
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        host, port = runner.addresses[0][:2]
        self.url = f"http://{host}:{port}"
        try:
            yield self
        finally:
            await runner.cleanup()
