"""Bytes a day of usual cells: what a whole daemon records and sends in some seconds, told for a day.

``record``: growth of the open file of the record, and what closing it adds. ``levels``: files of the page for ten
minutes of as many frames. ``zenoh``: bytes of TCP to one reader of everything, ``payload`` of them the content.
``mqtt``: bytes of TCP to Mosquitto, ``influx``: bodies of HTTP, both with a row of all channels a second.
"""

from __future__ import annotations

import asyncio
import math
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from outlet.servers import MOSQUITTO, mosquitto

from capacity.bus import SITE, free_port
from capacity.cells import KINDS, Kind, daemon, size_of
from capacity.children import Child, begun
from capacity.figures import Figures, Numbers, spread
from capacity.made import CELL, minutes
from capacity.model import DAY, MB
from capacity.wire import Counted, historian, passing
from cellwatt import Layout
from cellwatt.outlets.page.levels import Curves
from cellwatt.outlets.page.levels.store import ends_at
from cellwatt.record import Recording

LEVELS = 10
"""Minutes of frames of which level files are made."""
_INDEX, _PLACE = 81, 10
"""Bytes that a chunk, and each channel in it, take in the index of a closed file."""


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of each usual cell."""
    found: Figures = {}
    for name, kind in KINDS.items():
        runs: list[Numbers] = []
        topics: Figures = {}
        for _ in range(repeats):
            run, topics = asyncio.run(_run(kind, seconds))
            runs.append(run)
        found[name] = {"about": kind.about, **spread(runs), "topics": topics}
    return found


async def _run(kind: Kind, seconds: float) -> tuple[dict[str, float], Figures]:
    """MB a day by what takes them, and the messages of a second by topic."""
    port = free_port()
    with tempfile.TemporaryDirectory() as name, mosquitto(Path(name)) if MOSQUITTO else nullcontext() as broker:
        folder = Path(name)
        async with passing(port) as bus, passing(broker.port if broker else 1) as mqtt, historian() as influx:
            outlets: dict[str, Any] = {
                "historian": {"influx": {"url": f"http://127.0.0.1:{influx.port}", "database": "bench"}}
            }
            if broker:
                outlets["mqtt"] = {"broker": f"mqtt://127.0.0.1:{mqtt.port}"}
            async with daemon(kind, folder, {"listen": [f"tcp/127.0.0.1:{port}"]}, outlets):
                link = {"connect": [f"tcp/127.0.0.1:{bus.port}"]}
                reader = await asyncio.to_thread(begun, "read", link=link, keys=[f"cellwatt/{SITE}/**"], sessions=1)
                try:
                    await asyncio.to_thread(reader.ready)
                    found, topics = await _window(folder, seconds, reader, (bus, mqtt, influx))
                finally:
                    await asyncio.to_thread(reader.end)
        found["record"] += _closing(folder / "record") * DAY / MB
        shape = next(iter(Recording.open(folder / "record").frames())).layout
        found |= {"levels": _levels(shape), "channels": float(len(shape.channels))}
    if not broker:
        del found["mqtt"]
    return found, topics


async def _window(
    folder: Path, seconds: float, reader: Child, counted: tuple[Counted, ...]
) -> tuple[dict[str, float], Figures]:
    def look() -> tuple[float, ...]:
        bus, mqtt, influx = counted
        return time.monotonic(), _recorded(folder / "record"), bus.received, mqtt.sent, influx.sent

    await asyncio.sleep(2.0)
    await asyncio.to_thread(reader.ask, "begin")
    first = look()
    await asyncio.sleep(seconds)
    last = look()
    topics = (await asyncio.to_thread(reader.ask, "tell"))[0]["topics"]
    lasted, record, bus, mqtt, influx = (b - a for a, b in zip(first, last, strict=True))
    day = DAY / MB / lasted
    payload = sum(size for _, size in topics.values())
    found = {"record": record * day, "zenoh": bus * day, "payload": payload * day, "mqtt": mqtt * day}
    each = {
        topic: {"messages": round(n / lasted, 2), "bytes": round(size / n)} for topic, (n, size) in topics.items() if n
    }
    return {**found, "influx": influx * day}, each


def _recorded(folder: Path) -> int:
    return size_of([path for path in folder.iterdir() if ".mcap" in path.name])


def _closing(folder: Path) -> float:
    """Bytes a second of recording that the index of a closed file takes."""
    total, lasted = 0, 0.0
    for path in folder.glob("*.mcap"):
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None and summary.statistics is not None
        total += sum(_INDEX + _PLACE * len(index.message_index_offsets) for index in summary.chunk_indexes)
        lasted += (summary.statistics.message_end_time - summary.statistics.message_start_time) * 1e-9
    return total / lasted


def _levels(shape: Layout) -> float:
    """MB a day of the page's level files for frames of as many channels and the same rate."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        minutes(folder, len(shape.channels), shape.rate, LEVELS)
        store = Curves(folder, CELL).store
        for kept in store.recordings():
            store.made(kept, math.inf, ends_at(math.inf))
        return size_of(list((folder / "levels").iterdir())) * DAY / (60 * LEVELS) / MB
