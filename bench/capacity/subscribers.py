"""What one more reader costs a cell, directly and through a router, and from how many on its frames come late.

A whole daemon of an arm at 500 Hz and a power board, its readers in a process of their own with a session each.
``tell``: the share of a core of the process that publishes; ``reader``: that of the readers' process. ``late``: delay
of the frames at the worst reader beyond that of the median frame with one reader, p99; ``lost``: frames that did not
come.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from capacity.bus import SITE, free_port
from capacity.cells import KINDS, daemon, status
from capacity.children import Child, child
from capacity.figures import Figures, computed, spread

KIND = KINDS["arm, 50 Hz"]
COUNTS = (0, 1, 4, 12)
WANTS = {"frames": ("frame",), "everything": ("**",)}
WAYS = ("direct", "router")


def measure(seconds: float, repeats: int) -> Figures:
    """Figures by way and by what is read, for each number of readers, and what each of them adds."""
    runs = [{way: asyncio.run(_way(way, seconds)) for way in WAYS} for _ in range(repeats)]
    found: Figures = {}
    for way in WAYS:
        for want in WANTS:
            each = [run[way][want] for run in runs]
            rows = [{"readers": n, **spread([run[i] for run in each])} for i, n in enumerate(_counts(want))]
            found[f"{way}, {want}"] = {"rows": rows, **spread([_added(run, _counts(want)) for run in each])}
    return found


def _counts(want: str) -> Sequence[int]:
    return COUNTS if want == "everything" else COUNTS[1:]


def _added(rows: Sequence[dict[str, float]], counts: Sequence[int]) -> dict[str, float]:
    """Share of a core that each reader adds to ``tell`` and to the router: a line through the rows with readers."""
    with_readers = [(n, row) for n, row in zip(counts, rows, strict=True) if n]
    return {
        f"{part}_a_reader": float(
            np.polyfit([n for n, _ in with_readers], [row[part] for _, row in with_readers], 1)[0]
        )
        for part in ("tell", "router")
    }


async def _way(way: str, seconds: float) -> dict[str, list[dict[str, float]]]:
    place = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        router = stack.enter_context(child("route", listen=[place])).ready() if way == "router" else None
        link = {"mode": "client", "connect": [place]} if router else {"listen": [place]}
        async with daemon(KIND, Path(name), link):
            tell = (await asyncio.to_thread(status, place))["processes"]["tell"]["pid"]
            return {want: await asyncio.to_thread(_rows, place, want, tell, router, seconds) for want in WANTS}


def _rows(place: str, want: str, tell: int, router: Child | None, seconds: float) -> list[dict[str, float]]:
    rows = [_row(place, want, count, tell, router, seconds) for count in _counts(want)]
    usual = next(row["p50_ms"] for n, row in zip(_counts(want), rows, strict=True) if n)
    return [{**row, "late_ms": row["p99_ms"] - usual if row["p99_ms"] else 0.0} for row in rows]


def _row(place: str, want: str, count: int, tell: int, router: Child | None, seconds: float) -> dict[str, float]:
    keys = [f"cellwatt/{SITE}/*/{key}" for key in WANTS[want]]
    with ExitStack() as stack:
        readers = None
        if count:
            link = {"connect": [place]}
            readers = stack.enter_context(child("read", link=link, keys=keys, sessions=count)).ready()
        time.sleep(1.5)
        pids = {"tell": tell, "router": router and router.pid, "reader": readers and readers.pid}
        if readers:
            readers.ask("begin")
        before, began = {part: computed(pid) for part, pid in pids.items() if pid}, time.monotonic()
        time.sleep(seconds)
        lasted = time.monotonic() - began
        row = {part: (computed(pid) - before[part]) / lasted if pid else 0.0 for part, pid in pids.items()}
        told: list[dict[str, Any]] = readers.ask("tell") if readers else []
    row["lost"] = float(max((t.get("lost", 0) for t in told), default=0))
    row["p50_ms"] = max((t.get("p50_ms", 0.0) for t in told), default=0.0)
    row["p99_ms"] = max((t.get("p99_ms", 0.0) for t in told), default=0.0)
    row["messages"] = float(min((sum(n for n, _ in t["topics"].values()) for t in told), default=0)) / lasted
    return row
