"""The endpoint for Prometheus beside prometheus-client's own server with as many series."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import aiohttp
from prometheus_client import CollectorRegistry, Counter, start_http_server

from cellwatt.outlets.metrics.outlet import CellCollector, MetricsOutlet, exposed
from cellwatt.outlets.metrics.serving import FRESH
from cellwatt.outlets.metrics.settings import MetricsSettings
from outlet.figures import Figures, repeated
from outlet.loop import served, until
from outlet.rows import View, frames

OPEN_METRICS = "application/openmetrics-text"


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of the endpoint for Prometheus."""
    return repeated(lambda: asyncio.run(run(seconds)), repeats)


def _health(sources: int) -> Figures:
    """Health of a cell as its daemon tells it."""
    source = {
        "state": "ok", "expected": 10**6, "received": 10**6, "missed": {"gap": 4}, "dropped": {}, "residue": 0,
        "counters": {"event connected": 1, "reconnects": 2},
        "streams": {"rtde": {"nominal_hz": 500.0, "rate_hz": 500.0}},
        "clocks": {"rtde": {"bound_ns": 10**6, "resets": 0}},
    }  # fmt: skip
    process = {"pid": 1, "down": False, "silent_s": 0.1, "restarts": 0, "cpu_s": 1.0, "loop_lag_ms": 0.1}
    parts = ("collect", "align", "judge segment", "judge power", "tell")
    return {
        "state": "green",
        "sources": {f"arm_{n}": source for n in range(sources)},
        "processes": dict.fromkeys(parts, process),
        "alarms": [],
    }


async def run(seconds: float) -> dict[str, float]:
    """Figures of one run."""
    view: Any = View()
    outlet = MetricsOutlet("metrics", MetricsSettings(listen="127.0.0.1:0"), view)
    outlet.health(_health(16))
    outlet.offer(frames(0, 1))

    async def work() -> dict[str, float]:
        await until(lambda: outlet.url is not None)
        collector = CellCollector(outlet._meter, {})
        began = time.thread_time()
        for _ in range(20):
            text, _ = exposed(collector, OPEN_METRICS)
        cost = (time.thread_time() - began) / 20
        series = sum(line[:1] != b"#" for line in text.splitlines())
        ours = await _answers(f"{outlet.url}/metrics", seconds)
        async with _plain(series) as url:
            theirs = await _answers(url, seconds)
        return {
            "series": series, "bytes": len(text), "text_ms": 1e3 * cost, "fresh_s": FRESH,
            "answers_per_s": ours, "plain_answers_per_s": theirs,
        }  # fmt: skip

    return await served(outlet, work)


async def _answers(url: str, seconds: float) -> float:
    count = 0
    async with aiohttp.ClientSession(headers={"Accept": OPEN_METRICS}) as session:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            async with session.get(url) as answer:
                await answer.read()
            count += 1
    return count / seconds


@asynccontextmanager
async def _plain(series: int) -> AsyncIterator[str]:
    """prometheus-client's own server with as many series."""
    registry = CollectorRegistry()
    counter = Counter("samples", "Samples.", ["source"], registry=registry)
    for n in range(series):
        counter.labels(f"arm_{n}").inc()
    server, thread = start_http_server(0, "127.0.0.1", registry)
    try:
        yield f"http://127.0.0.1:{server.server_port}/metrics"
    finally:
        await asyncio.to_thread(server.shutdown)
        server.server_close()
        await asyncio.to_thread(thread.join)
