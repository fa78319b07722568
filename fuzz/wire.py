"""What the daemon reads of a process that serves for an outlet."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from cellwatt.errors import OutletError
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.page.outlet import PageOutlet, PageSettings
from fuzz.items import SESSION
from fuzz.target import Target


class _Writer:
    """Keeps nothing."""

    def is_closing(self) -> bool:
        return False

    def write(self, data: bytes) -> None:
        assert data


def run(data: bytes) -> None:
    """All until the process closes."""
    asyncio.run(_run(data))


async def _run(data: bytes) -> None:
    writer: Any = _Writer()
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
    """A process that lives, orders and fails."""
    order = {"number": 1, "what": "shelve", "alarm": "a1", "name": "Ada", "note": "", "until": SESSION}
    yield wire.from_process(Kind.ALIVE, {"counts": {"browsers refused": 1}}) + wire.from_process(Kind.ORDER, order)
    yield wire.from_process(Kind.FAILED, {"error": "no"})
    yield wire.from_process(Kind.ALIVE, {"counts": ["a"]})
    yield wire.from_process(Kind.ORDER, [])


TARGET = Target(run, seeds, 2048)
