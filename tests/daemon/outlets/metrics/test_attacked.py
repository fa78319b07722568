"""The process that serves the metrics, attacked: the daemon beside it loses no descriptor, and readers are served."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import aiohttp

from cellwatt.outlets.metrics.outlet import MetricsOutlet
from tests.daemon.outlets.metrics.cell import health, outlet_of
from tests.daemon.outlets.serving import serving
from tests.left_behind import sockets
from tests.patience import eventually


async def test_strangers_cost_the_daemon_nothing() -> None:
    outlet = outlet_of(token="t0p")
    outlet.health(health())
    async with serving(outlet) as url:
        await attacked(outlet, url)
    assert outlet.url is None


async def attacked(outlet: MetricsOutlet, url: str) -> None:
    host, port = url.removeprefix("http://").split(":")
    before = sockets()
    idle = [await asyncio.open_connection(host, int(port)) for _ in range(300)]
    try:
        assert len(sockets().keys() - before) == 300, "ours, and none of the outlet"
        async with aiohttp.ClientSession() as session:
            right = {"Authorization": "Bearer t0p"}
            async with session.get(f"{url}/metrics", headers=right) as answer:
                assert answer.status == 200
                assert 'cellwatt_samples_received_total{source="arm"} 1000.0' in await answer.text()
            wrong = {"Authorization": "Bearer guess"}
            statuses = []
            while len(statuses) < 100 and 429 not in statuses:
                async with session.get(f"{url}/metrics", headers=wrong) as answer:
                    statuses.append(answer.status)
            async with session.get(f"{url}/metrics", headers=right) as answer:
                assert answer.status == 200, "who has the token is not locked out by who has not"
        assert statuses[:5] == [401] * 5
        assert statuses[-1] == 429
        await eventually(lambda: outlet.account.counters["logins refused"] == 1)
        assert outlet.account.counters["failed logins"] == len(statuses) - 1
        assert outlet.account.counters["connections displaced"] >= 200
    finally:
        for _, writer in idle:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
