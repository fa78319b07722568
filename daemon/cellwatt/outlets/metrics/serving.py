"""The endpoint: metrics for who may read them, and probes for everybody."""

from __future__ import annotations

import base64
import binascii
import hmac
import ssl
import time
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from typing import Final

from aiohttp import hdrs, web

from cellwatt.errors import OutletError, why
from cellwatt.outlets.metrics.exposition import CellCollector, exposed
from cellwatt.outlets.metrics.meter import Meter
from cellwatt.outlets.metrics.settings import MetricsSettings

STALE: Final = 10.0
"""s without a look at the cell's health after which it is not ready; one comes each second."""
FRESH: Final = 0.2
"""s for which the same text is given again: many readers cost no more than one."""
_LONGEST: Final = 1000
"""Characters of a reason."""
_IDLE, _STOP = 75.0, 1.0  # s
_HEADERS: Final = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Server": "cellwatt"}


class Endpoint:
    """Serves the metrics of a meter by the settings."""

    def __init__(self, settings: MetricsSettings, meter: Meter) -> None:
        self._settings, self._meter = settings, meter
        self._collector = CellCollector(meter, settings.labels)
        self._texts: dict[bool, tuple[float, bytes, str]] = {}
        self._runner: web.AppRunner | None = None

    async def start(self, context: ssl.SSLContext | None) -> str:
        """Begin to serve; return the address. Raises ``OutletError`` if that cannot be."""
        app = web.Application(client_max_size=1024)
        app.on_response_prepare.append(_prepare)
        ways: dict[str, Callable[[web.Request], Awaitable[web.Response]]] = {
            "/metrics": self._metrics,
            "/healthz": self._alive,
            "/readyz": self._ready,
            "/startupz": self._started,
        }
        app.add_routes([web.get(path, handler) for path, handler in ways.items()])
        runner = self._runner = web.AppRunner(app, access_log=None, keepalive_timeout=_IDLE, shutdown_timeout=_STOP)
        await runner.setup()
        listen = self._settings.listen
        try:
            await web.TCPSite(runner, self._settings.host, self._settings.port, ssl_context=context).start()
        except OSError as error:
            await self.stop()
            if "in use" in why(error).lower():
                raise OutletError(f"{listen} is taken by another program: choose another port in listen") from None
            raise OutletError(f"{listen} cannot be listened at: {why(error)}") from None
        host = listen.rpartition(":")[0]
        return f"{'http' if context is None else 'https'}://{host}:{runner.addresses[0][1]}"

    async def stop(self) -> None:
        """Serve no more."""
        if self._runner is not None:
            await self._runner.cleanup()
            self._runner = None

    async def _metrics(self, request: web.Request) -> web.Response:
        if not self._known(request):
            ways = [*(["Bearer"] if self._settings.token else []), *(["Basic"] if self._settings.password else [])]
            headers = {"WWW-Authenticate": ", ".join(f'{way} realm="cellwatt"' for way in ways)}
            return _line("a token or password is needed", HTTPStatus.UNAUTHORIZED, headers)
        self._meter.scrapes += 1
        accept = request.headers.get(hdrs.ACCEPT, "")
        # Of the many headers that readers may send, two texts come: a memory of them is bounded so.
        open_metrics, now = "application/openmetrics-text" in accept, time.monotonic()
        made, text, kind = self._texts.get(open_metrics, (-FRESH, b"", ""))
        if now - made >= FRESH:
            text, kind = exposed(self._collector, "application/openmetrics-text" if open_metrics else "")
            self._texts[open_metrics] = now, text, kind
        answer = web.Response(body=text, headers={hdrs.CONTENT_TYPE: kind})
        answer.enable_compression()
        return answer

    async def _alive(self, _: web.Request) -> web.Response:
        return _line("alive", HTTPStatus.OK)

    async def _ready(self, request: web.Request) -> web.Response:
        problem = self._unready()
        if problem is None:
            return _line(str(self._meter.status.get("state")), HTTPStatus.OK)
        told = problem if self._known(request) else "not ready"
        return _line(told, HTTPStatus.SERVICE_UNAVAILABLE)

    async def _started(self, _: web.Request) -> web.Response:
        if self._meter.age(time.monotonic()) is None:
            return _line("starting", HTTPStatus.SERVICE_UNAVAILABLE)
        return _line("started", HTTPStatus.OK)

    def _unready(self) -> str | None:
        """Reason why the cell is not ready, in one line; ``None`` if it is."""
        age = self._meter.age(time.monotonic())
        if age is None:
            return "starting: the cell's health is not known yet"
        if age > STALE:
            return f"the cell's health was last looked at {age:.0f} s ago"
        status = self._meter.status
        if status.get("state") != "red":
            return None
        return f"red: {'; '.join(status.get('reasons', ())) or 'no source delivers, or nothing can be recorded'}"

    def _known(self, request: web.Request) -> bool:
        """True if a reader shows what the settings ask for, or they ask for nothing."""
        settings = self._settings
        if not settings.asks:
            return True
        way, _, shown = request.headers.get(hdrs.AUTHORIZATION, "").partition(" ")
        if way.lower() == "bearer" and settings.token is not None:
            return hmac.compare_digest(shown.strip().encode(), settings.token.get_secret_value().encode())
        if way.lower() == "basic" and settings.password is not None:
            try:
                given = base64.b64decode(shown, validate=True)
            except (binascii.Error, ValueError):
                return False
            return hmac.compare_digest(given, f"{settings.user}:{settings.password.get_secret_value()}".encode())
        return False


async def _prepare(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)


def _line(text: str, status: int, headers: dict[str, str] | None = None) -> web.Response:
    return web.Response(text=f"{' '.join(text.split())[:_LONGEST]}\n", status=status, headers=headers)
