"""A cell for the page's tests: frames, results, a view that notes what people order, and a page served in-process."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np

from cellwatt import CellwattError, FrameChannel, Frames, Layout
from cellwatt.outlets.page import app
from cellwatt.outlets.page.app import Page
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.cells import Cell, OneCell, prefix
from cellwatt.outlets.page.dropped import Drops
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import hash_of
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.results import Energy, Interval, Prediction, Task
from tests.daemon.outlets.zenoh import fake_cell
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView

MS = EPOCH / 1e6
API = f"/api/cells/{SITE}/{CELL}"
LAYOUT = Layout((*fake_cell.LAYOUT.channels, FrameChannel("arm.mode", "1", "discrete", "hold")), 50.0)
PASSWORD = "correct horse"
HASH = str(hash_of(PASSWORD, 2**14, 8, 1))
USERS = {"ada": {"password": HASH, "may": "act"}, "eve": {"password": HASH}}


def frames(first: int, count: int, layout: Layout = LAYOUT) -> Frames:
    """Frames whose values say which they are: n/3, 100 + n, 4,000,000,000 + n; the power is missing every tenth."""
    numbers = np.arange(first, first + count)
    width = len(layout.channels)
    values = np.column_stack([numbers / 3, np.where(numbers % 10 == 9, np.nan, 100.0 + numbers), 4e9 + numbers])
    values = np.resize(values, (count, width)) if width != 3 else values
    quality = np.zeros((count, width), np.uint8)
    quality[numbers % 10 == 9, 1] = 4
    return Frames(layout, first, EPOCH + numbers * layout.step, values, quality, np.ones((count, width), np.int64))


def interval(number: int) -> Interval:
    start = EPOCH + number * 1_000_000_000
    return Interval("arm", number, start, start + 500_000_000, (1, 2), (0.5,), (0.1,), (1.0,))


TASK = Task("arm", "task_1", "abc", "speed=1.00", 1.0, EPOCH, EPOCH + 7_000_000_000, (1, 2), 3)
ENERGY = Energy(
    "arm", "task_1", "speed=1.00", 3, EPOCH, EPOCH + 7_000_000_000, 900.0, {"motion": 600.0}, 5.0, 400.0, 44.0
)
PREDICTION = Prediction("power", 0, (EPOCH, EPOCH + 20_000_000), {"power": (101.0, float("nan"))}, {"power": "W"})


def shelved(number: int) -> dict[str, Any]:
    """An alarm on the shelf, as health tells it."""
    shelf = {"name": "ada", "note": "known", "time": EPOCH + 1_000_000, "until": EPOCH + 60_000_000_000}
    return {
        "id": f"alarm-{number}",
        "kind": "joint_fault",
        "severity": "error",
        "statement": "It squeaks.",
        "since": EPOCH,
        "shelf": {**shelf, "severity": "error"},
    }


def status(alarms: Sequence[Mapping[str, Any]] = (), shelved: Sequence[Mapping[str, Any]] = (), **more: Any) -> Any:
    """Health as the daemon tells it."""
    return {
        **fake_cell.STATUS,
        "session": EPOCH,
        "time": EPOCH + 10_000_000_000,
        "sources": {"arm": {"state": "ok", "received": 70, "missed": {"gap": 2}, "dropped": {"queue": 1}}},
        "alarms": list(alarms),
        "shelved": list(shelved),
        **more,
    }


class View(FakeView):
    """A cell whose daemon notes what people order, and refuses what is about ``refused``."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.ordered: list[tuple[Any, ...]] = []

    def acknowledge(self, alarm_id: str, name: str, note: str) -> None:
        self._note("acknowledge", alarm_id, name, note)

    def shelve(self, alarm_id: str, until: int, name: str, note: str) -> None:
        self._note("shelve", alarm_id, until, name, note)

    def unshelve(self, alarm_id: str, name: str) -> None:
        self._note("unshelve", alarm_id, name)

    def _note(self, *order: Any) -> None:
        if order[1] == "alarm-13":
            raise CellwattError("no alarm 'alarm-13' is active: it may have been cleared")
        self.ordered.append(order)


@dataclass
class Served:
    """A page and what belongs to it."""

    url: str
    page: Page
    feed: Feed
    browsers: Browsers
    orders: list[Mapping[str, Any]]


@asynccontextmanager
async def served(*, archive: Any = None, drops: Drops | None = None, **settings: Any) -> AsyncIterator[Served]:
    """A page of one cell without a daemon."""
    made = PageSettings(**{"listen": "127.0.0.1:0", **settings})
    browsers, desk, orders = Browsers(made.browsers), Desk(), []
    feed = Feed(SITE, CELL, Hub(browsers), f"{prefix(SITE, CELL)}/reports")

    async def order(what: Mapping[str, Any]) -> None:
        orders.append(what)

    cells = OneCell(Cell(feed, archive or Archive(None, CELL, made.reports, desk), order))
    try:
        async with app.served(made, cells, browsers, drops=drops) as page:
            yield Served(page.url.rstrip("/"), page, feed, browsers, orders)
    finally:
        await asyncio.to_thread(desk.close)


def client() -> aiohttp.ClientSession:
    """A browser: it keeps cookies, also of addresses."""
    return aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True))


async def get(browser: aiohttp.ClientSession, url: str, status: int = 200) -> Any:
    """What is answered in JSON."""
    async with browser.get(url) as response:
        assert response.status == status, f"{url}: {await response.text()}"
        assert response.content_type == "application/json"
        return await response.json()


async def csrf(browser: aiohttp.ClientSession, url: str) -> dict[str, str]:
    """The header that a page of ours puts on what it posts."""
    return {"X-CSRF-Token": (await get(browser, f"{url}/api/site"))["csrf"]}


async def post(browser: aiohttp.ClientSession, url: str, path: str, body: Any, status: int = 200) -> Any:
    """What a page answers that is told something by one of its own."""
    async with browser.post(url + path, json=body, headers=await csrf(browser, url)) as response:
        assert response.status == status, await response.text()
        return await response.json()


async def log_in(browser: aiohttp.ClientSession, url: str, name: str, password: str = PASSWORD) -> int:
    header = await csrf(browser, url)
    async with browser.post(f"{url}/api/login", json={"name": name, "password": password}, headers=header) as response:
        return response.status


class Stream:
    """What a browser reads of a stream, event by event."""

    def __init__(self, response: aiohttp.ClientResponse) -> None:
        self._response = response

    async def next(self) -> tuple[str, Any]:
        kind = ""
        while True:
            line = (await self._response.content.readline()).decode().rstrip("\n")
            if line.startswith("event: "):
                kind = line[7:]
            elif line.startswith("data: "):
                return kind, json.loads(line[6:])
            elif not line and self._response.content.at_eof():
                raise EOFError

    async def until(self, kind: str) -> Any:
        while True:
            found, data = await self.next()
            if found == kind:
                return data
