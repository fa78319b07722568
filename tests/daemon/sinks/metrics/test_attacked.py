"""The process that serves the metrics, attacked: the daemon beside it loses no descriptor, and readers are served."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path

import aiohttp

from cellwatt.errors import SinkError
from tests.daemon.sinks.metrics.cell import health, sink_of
from tests.patience import eventually


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


async def test_strangers_cost_the_daemon_nothing() -> None:
    sink = sink_of(token="t0p")
    sink.health(health())
    running = asyncio.create_task(sink.run())
    await eventually(lambda: sink.url or running.done())
    assert sink.url is not None
    host, port = sink.url.removeprefix("http://").split(":")
    before = descriptors()
    idle = [await asyncio.open_connection(host, int(port)) for _ in range(300)]
    try:
        assert descriptors() == before + 300, "ours, and none of the sink"
        async with aiohttp.ClientSession() as session:
            right = {"Authorization": "Bearer t0p"}
            async with session.get(f"{sink.url}/metrics", headers=right) as answer:
                assert answer.status == 200
                assert 'cellwatt_samples_received_total{source="arm"} 1000.0' in await answer.text()
            async with session.get(f"{sink.url}/healthz") as answer:
                assert await answer.text() == "alive\n"
            wrong = {"Authorization": "Bearer guess"}
            statuses = []
            for _ in range(8):
                async with session.get(f"{sink.url}/metrics", headers=wrong) as answer:
                    statuses.append(answer.status)
        assert statuses == [401] * 5 + [429] * 3
        await eventually(lambda: sink.account.counters["logins refused"] == 3)
        assert sink.account.counters["failed logins"] == 5
        assert sink.account.counters["connections displaced"] >= 200
    finally:
        for _, writer in idle:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
        running.cancel()
        with suppress(asyncio.CancelledError, SinkError):
            await running
    assert sink.url is None
