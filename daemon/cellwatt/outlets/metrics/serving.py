"""The process that serves metrics to authorised readers; started by the outlet."""

from __future__ import annotations

import asyncio
import hmac
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from http import HTTPStatus
from typing import Any, Final

from aiohttp import hdrs, web

from cellwatt.door.http import HttpDoor
from cellwatt.door.port import Limits
from cellwatt.door.settings import tls_context
from cellwatt.door.tries import Guard
from cellwatt.errors import CellwattError
from cellwatt.outlets.apart.daemon import Daemon, Shown, main
from cellwatt.outlets.metrics.settings import MetricsSettings

FRESH: Final = 0.2
"""Time, s, for which an answer is reused, so that many readers cost no more than one."""
LIMITS: Final = Limits(connections=64, peer=32)
_HEADERS: Final = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Server": "cellwatt"}
_OPEN: Final = "application/openmetrics-text"

Ask = Callable[[Mapping[str, Any]], Awaitable[Any]]


class _Text:
    """The daemon's text of a format, requested again when it is older than ``FRESH``."""

    def __init__(self, ask: Ask, accept: str) -> None:
        self._ask, self._accept = ask, accept
        self._answer: Any = None
        self._at = -FRESH
        self._asking = asyncio.Lock()
        self.readers = 0
        """Number of readers since the daemon was last asked."""

    async def get(self) -> Any:
        self.readers += 1
        async with self._asking:
            if time.monotonic() - self._at >= FRESH:
                counted, self.readers = self.readers, 0
                self._answer = await self._ask({"accept": self._accept, "scrapes": counted})
                self._at = time.monotonic()
        return self._answer


class Endpoint:
    """Serves the daemon's answers to ``ask``, see ``MetricsOutlet.answer``, according to the settings."""

    def __init__(self, settings: MetricsSettings, ask: Ask) -> None:
        self._settings = settings
        # Readers send many headers, which select only two texts: the cache is bounded.
        self._texts = {way: _Text(ask, _OPEN if way else "") for way in (True, False)}
        app = web.Application(client_max_size=1024, middlewares=[_unanswered])
        app.on_response_prepare.append(_prepare)
        app.add_routes([web.get("/metrics", self._metrics)])
        self.door = HttpDoor(app, settings, LIMITS)
        self._guard = Guard("metrics", self.door.counts)

    async def _metrics(self, request: web.Request) -> web.Response:
        if (refused := self._refused(request)) is not None:
            return refused
        reply = await self._texts[_OPEN in request.headers.get(hdrs.ACCEPT, "")].get()
        answer = web.Response(body=reply["text"].encode(), headers={hdrs.CONTENT_TYPE: reply["type"]})
        answer.enable_compression()
        return answer

    def _refused(self, request: web.Request) -> web.Response | None:
        """The refusal of a reader without the token of the settings; ``None`` if the reader is admitted."""
        token = self._settings.token
        if token is None:
            return None
        headers = {"WWW-Authenticate": 'Bearer realm="cellwatt"'}
        if hdrs.AUTHORIZATION not in request.headers:
            return _line("a token is needed", HTTPStatus.UNAUTHORIZED, headers)
        way, _, shown = request.headers[hdrs.AUTHORIZATION].partition(" ")
        given = shown.strip().encode("utf-8", "surrogateescape")  # a header is bytes
        if way.lower() == "bearer" and hmac.compare_digest(given, token.get_secret_value().encode()):
            return None  # also while failed logins delay others: nobody can lock out Prometheus
        address = request.remote or ""
        if wait := self._guard.begin(address, ""):
            text = f"too many attempts: wait {wait:.0f} s"
            return _line(text, HTTPStatus.TOO_MANY_REQUESTS, {"Retry-After": f"{max(wait, 1.0):.0f}"})
        self._guard.fail(address, "")
        return _line("this token is wrong", HTTPStatus.UNAUTHORIZED, headers)


@web.middleware
async def _unanswered(request: web.Request, handler: Callable[[web.Request], Awaitable[Any]]) -> web.StreamResponse:
    try:
        response: web.StreamResponse = await handler(request)
    except CellwattError as error:
        return _line(str(error), HTTPStatus.SERVICE_UNAVAILABLE)
    return response


async def _prepare(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)


def _line(text: str, status: int, headers: dict[str, str] | None = None) -> web.Response:
    return web.Response(text=f"{text}\n", status=status, headers=headers)


async def serve(daemon: Daemon, hello: Mapping[str, Any]) -> None:
    """Serve the daemon's answers until it disconnects. Raises ``OutletError`` if it cannot listen."""
    read = hello["settings"]
    endpoint = Endpoint(read, daemon.order)
    url = await endpoint.door.start(await asyncio.to_thread(tls_context, read))
    try:
        await daemon.serve(url, lambda: endpoint.door.counts, Shown())
    finally:
        await endpoint.door.stop()


if __name__ == "__main__":
    main(serve, logging.INFO)
