"""Requests to the page: hosts, cookies, tokens against forgery, queries and bodies."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any, Final

from aiohttp import streams, web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.http_parser import HeadersParser
from aiohttp.test_utils import make_mocked_request
from multidict import CIMultiDict, CIMultiDictProxy
from yarl import URL

from cellwatt.errors import CellwattError
from cellwatt.outlets.page.app import Assets, Page
from cellwatt.outlets.page.archive import Archive, Desk, P, T
from cellwatt.outlets.page.cells import Cell, OneCell
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.gate import Gate
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import Sessions
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.results import Alarm
from fuzz.items import MESSAGES, SESSION
from fuzz.target import Target

CELL: Final = "/api/cells/plant/weld"
TOKEN: Final = "browser"
PROOF: Final = b"PROOF"
"""Stands in an input for the token against forgery that belongs to ``TOKEN``: no search would find it."""


class _Hub(Hub):
    """Begins no stream, which would never end."""

    async def serve(
        self,
        request: web.Request,
        channels: Sequence[str],
        rate: float,
        login: object = None,
        first: Sequence[bytes] = (),
    ) -> web.Response:
        assert len(channels) <= 102
        assert 0.1 <= rate <= 25.0
        return web.Response()


class _Desk(Desk):
    """Answers at once, without threads."""

    async def ask(self, work: Callable[P, T], *args: P.args, **more: P.kwargs) -> T:
        return work(*args, **more)


@cache
def _page() -> tuple[web.Application, bytes]:
    settings = PageSettings()
    sessions = Sessions(None, lambda _: None)
    browsers = Browsers(settings.browsers)
    feed = Feed("plant", "weld", _Hub(browsers))
    alarm = next(message for message in MESSAGES if isinstance(message, Alarm))
    feed.take_item(alarm)

    async def order(told: Mapping[str, Any]) -> None:
        assert told["what"] in ("acknowledge", "shelve", "unshelve")
        json.dumps(told)
        raise CellwattError("no")

    cell = Cell(feed, Archive(None, "weld", None, _Desk()), order)
    page = Page(settings, Gate(settings, sessions), OneCell(cell), Assets(), browsers)
    application = page.application()
    application.freeze()
    return application, sessions.csrf(TOKEN).encode()


def run(data: bytes) -> None:
    """A request as it stands on the wire: its line, headers, an empty line, its body."""
    asyncio.run(_run(data))


async def _run(data: bytes) -> None:
    application, proof = _page()
    head, _, body = data.replace(PROOF, proof).partition(b"\n\n")
    first, *lines = head.split(b"\n")
    words = first.decode("utf-8", "surrogateescape").split(" ")
    if len(words) != 2 or not words[1].startswith("/") or not words[0].isalpha():
        return
    try:
        headers = CIMultiDict(HeadersParser().parse_headers([*lines, b""])[0])
        path = str(URL(words[1], encoded=True))
        request = make_mocked_request(words[0].upper(), path, None, payload=_payload(body))
    except (HttpProcessingError, ValueError, UnicodeError, IndexError):
        return  # aiohttp answers these itself
    # The library's own mock has no headers that are not UTF-8; its server has.
    request._message = request._message._replace(headers=CIMultiDictProxy(headers))
    request._headers = request._message.headers
    answer = await application._handle(request)
    assert answer.status != 500, answer
    if answer.status >= 400 and isinstance(answer, web.Response):
        assert isinstance(answer.body, bytes)
        assert "\n" not in json.loads(answer.body)["error"]


def _idle(**_: object) -> None:
    return None


def _payload(body: bytes) -> streams.StreamReader:
    protocol: Any = SimpleNamespace(_reading_paused=False, pause_reading=_idle, resume_reading=_idle)
    reader = streams.StreamReader(protocol, 2**16, loop=asyncio.get_running_loop())
    reader.feed_data(body)
    reader.feed_eof()
    return reader


def seeds() -> Iterable[bytes]:
    """Each question, and orders as the page's own scripts give them."""
    local = b"\nHost: 127.0.0.1:8480"
    for asked in ("state", "stream?channels=a,b&rate=5", "alarms?limit=2", "reports", "mismatch", "reports/a/b.html"):
        yield f"GET {CELL}/{asked}".encode() + local
    yield f"GET {CELL}/curves?channels=arm.mode&from={SESSION // 10**6}&to=99999999999999&points=5".encode() + local
    yield b"GET /api/site" + local + b"\nCookie: cellwatt-8480=browser; other=\xff"
    yield b"GET /" + b"\nHost: elsewhere.example"
    known = local + b"\nCookie: cellwatt-8480=browser\nX-CSRF-Token: PROOF\nContent-Type: application/json"
    for what, more in (("acknowledge", {}), ("shelve", {"minutes": 10}), ("unshelve", {})):
        body = json.dumps({"id": "a1", "name": "Ada", "note": "seen", **more}).encode()
        yield f"POST {CELL}/{what}".encode() + known + b"\n\n" + body
    yield b"POST /api/login" + known + b'\n\n{"name": "ada", "password": "x"}'
    yield b"POST /api/logout" + known + b"\nOrigin: http://127.0.0.1:8480\n\n{}"
    yield b"POST /api/logout" + known + b"\nOrigin: http://[::1\n\n{}"
    yield b"POST /api/logout" + local + b"\nCookie: cellwatt-8480=\xff\nX-CSRF-Token: \xff\n\n{}"


TARGET = Target(run, seeds, 2048)
