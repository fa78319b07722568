"""Rows into InfluxDB: through the outlet, by plain posts, and from a record."""

from __future__ import annotations

import asyncio
import gzip
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import aiohttp

from cellwatt.outlets.historian.client import Client, row_line
from cellwatt.outlets.historian.outlet import HistorianOutlet, Lines
from cellwatt.outlets.historian.settings import HistorianSettings, InfluxSettings
from cellwatt.outlets.past import read
from cellwatt.outlets.selection import Picker
from outlet.loop import served, until
from outlet.rows import BLOCK, CELL, LAYOUT, RATE, START, View, frames
from outlet.servers import DATABASE

Way = Callable[[str, float], Coroutine[Any, Any, dict[str, float]]]
"""Sends rows to a server for some seconds."""
STEP = 6 * 10**9
"""ns of the record that are filled in at a time."""


def settings_for(url: str) -> InfluxSettings:
    """Settings of the outlet."""
    return InfluxSettings(url=url, database=DATABASE, rate=RATE, every=0.01, queue=100_000)


async def offered(url: str, seconds: float) -> dict[str, float]:
    """Rows a second through the outlet, offered as fast as they are taken."""
    view: Any = View()
    outlet = HistorianOutlet("historian", HistorianSettings(influx=settings_for(url)), view)
    assert outlet._influx is not None
    items = outlet._influx._items

    async def work() -> dict[str, float]:
        given, began = 0, time.monotonic()
        while time.monotonic() < began + seconds:
            outlet.offer(frames(given, BLOCK))
            given += BLOCK
            await until(lambda: len(items) <= 40, 0.0)
        await until(lambda: outlet.account.received >= given - 1)
        return {"rows_per_s": outlet.account.received / (time.monotonic() - began)}

    return await served(outlet, work)


async def posted(url: str, seconds: float) -> dict[str, float]:
    """The same lines, made before, posted one batch after the other."""
    settings = settings_for(url)
    rows = list(Picker(settings, LAYOUT).rows(frames(0, settings.batch)))
    body = "\n".join(row_line("plain", {"cell": CELL}, row) for row in rows).encode()
    count, began = 0, time.monotonic()
    async with aiohttp.ClientSession(headers={"Content-Encoding": "gzip"}) as session:
        while time.monotonic() < began + seconds:
            packed = await asyncio.to_thread(gzip.compress, body, 5)
            async with session.post(f"{url}/write?db={DATABASE}&precision=ns", data=packed) as answer:
                answer.raise_for_status()
            count += len(rows)
    return {"rows_per_s": count / (time.monotonic() - began)}


async def filled(url: str, record: Path, length: int) -> dict[str, float]:
    """Rows a second from a record of so many seconds."""
    settings, sent, began = settings_for(url), 0, time.monotonic()
    async with Client(settings) as client:
        peer = Lines(client, settings.measurement, {"cell": CELL}, None)
        for at in range(START, START + length * 10**9, STEP):
            part = await asyncio.to_thread(read, record, CELL, settings, at, at + STEP, 10**6)
            lines = [line for row in part.rows if (line := peer.row(row, part.units)) is not None]
            await peer.send(lines)
            sent += len(lines)
    return {"rows_per_s": sent / (time.monotonic() - began)}
