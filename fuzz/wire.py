"""Messages between the daemon and the processes that serve for outlets, both ways."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.daemon import Daemon, Shown
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.outlet import PageOutlet, PageSettings
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.results import Event
from fuzz.items import LAYOUT, MESSAGES, SESSION, frames, same
from fuzz.target import Target


class _Writer:
    """Keeps nothing."""

    def is_closing(self) -> bool:
        return False

    def write(self, data: bytes) -> None:
        assert data


def run(data: bytes) -> None:
    """What one side reads until the other closes: as the process that serves, then as the daemon."""
    asyncio.run(_both(data))


async def _both(data: bytes) -> None:
    writer: Any = _Writer()
    feed = Feed("plant", "weld", Hub(Browsers(1)))
    with suppress(ProtocolError):
        await Daemon(_reader(data), writer).hear(Shown(feed.take_frames))
    view: Any = SimpleNamespace(acknowledge=_done, shelve=_done, unshelve=_done)
    outlet = PageOutlet("page", PageSettings(), view)
    with suppress(OutletError):
        await outlet._listen(_reader(data), writer)
    outlet.account.snapshot()


def _done(*_: object) -> None:
    return None


def _reader(data: bytes) -> asyncio.StreamReader:
    reader = asyncio.StreamReader()
    reader.feed_data(data)
    reader.feed_eof()
    return reader


def seeds() -> Iterable[bytes]:
    """A cell that tells all, and a process that lives, orders and fails."""
    items = [message for message in MESSAGES if isinstance(message, Event)]
    block = frames(0, 3)
    assert same(wire.read_layout(wire.layout(LAYOUT)[wire.HEAD.size :]), LAYOUT)
    yield wire.layout(LAYOUT) + wire.frames(block) + b"".join(wire.item(item) for item in items)
    yield wire.json_message(Kind.HEALTH, {"state": "ok"}) + wire.json_message(Kind.ANSWER, {"number": 0, "error": None})
    order = {"number": 1, "what": "shelve", "alarm": "a1", "name": "Ada", "note": "", "until": SESSION}
    yield wire.json_message(Kind.ALIVE, {"counts": {"browsers refused": 1}}) + wire.json_message(Kind.ORDER, order)
    yield wire.json_message(Kind.FAILED, {"error": "no"})
    yield wire.json_message(Kind.ALIVE, {"counts": ["a"]})
    yield wire.json_message(Kind.ORDER, [])


TARGET = Target(run, seeds, 2048)
