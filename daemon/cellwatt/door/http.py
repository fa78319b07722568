"""An HTTP application behind a port with limits."""

from __future__ import annotations

import asyncio
import logging
import ssl
from typing import Final

from aiohttp import ClientPayloadError, web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.typedefs import Handler

from cellwatt.door.port import Limits, Port
from cellwatt.door.settings import Listening

BODY: Final = 10.0
"""Longest time, s, to receive the body of a request after its head."""
_STOP: Final = 1.0
"""Time, s, for answers in progress to complete when the door closes."""
_LINGERS: Final = 0.5
"""Time, s, to read the rest of an unwanted body, so that the client reads the refusal."""
_LONGEST: Final = 4096
"""Most bytes of a line in a request's head, which has at most ``_MOST`` lines."""
_MOST: Final = 64


class HttpDoor:
    """Serves ``app`` at the address of ``settings``, within ``limits``; ``counts`` counts refused requests.

    ``reader`` is a handler that reads the body of its requests in pieces, with its own deadlines.
    """

    def __init__(
        self, app: web.Application, settings: Listening, limits: Limits = Limits(), reader: Handler | None = None
    ) -> None:
        self._settings, self._reader = settings, reader
        self._log = logging.Logger(__name__)
        self._log.parent = logging.getLogger(__name__)
        self._log.addFilter(self._ours)
        self._runner = web.AppRunner(
            app,
            access_log=None,
            logger=self._log,
            keepalive_timeout=limits.idle,
            shutdown_timeout=_STOP,
            lingering_time=_LINGERS,
            max_line_size=2 * _LONGEST,
            max_field_size=_LONGEST,
            max_headers=_MOST,
        )
        app.middlewares.append(self._bounded)  # inner to the middlewares that format errors
        self._port = Port(lambda: self._protocol(), limits)
        self.counts = self._port.counts

    async def start(self, context: ssl.SSLContext | None) -> str:
        """Begin to serve; return the URL. Raises ``OutletError`` on failure."""
        await self._runner.setup()
        try:
            port = await self._port.open(self._settings.host, self._settings.port, context)
        except BaseException:
            await self._runner.cleanup()
            raise
        shown = self._settings.listen.rpartition(":")[0]
        return f"{'http' if context is None else 'https'}://{shown}:{port}"

    async def stop(self) -> None:
        """Stop serving."""
        await self._port.close()
        await self._runner.cleanup()

    def __len__(self) -> int:
        return len(self._port)

    def _ours(self, record: logging.LogRecord) -> bool:
        """Log filter: count malformed requests instead of logging them."""
        error = record.exc_info[1] if record.exc_info else None
        foreign = isinstance(error, HttpProcessingError | ConnectionError)
        self.counts["requests malformed"] += foreign
        return not foreign

    def _protocol(self) -> asyncio.Protocol:
        server = self._runner.server
        assert server is not None
        return server()

    @web.middleware
    async def _bounded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        with self._port.busy(request.transport):
            if request.body_exists and request.match_info.handler != self._reader:
                try:
                    async with asyncio.timeout(BODY):
                        await request.read()
                except (ConnectionError, ClientPayloadError) as error:
                    raise web.HTTPBadRequest(text="the body of the request broke off") from error
                except TimeoutError:
                    raise web.HTTPRequestTimeout(text="the body of the request did not come in time") from None
            return await handler(request)
