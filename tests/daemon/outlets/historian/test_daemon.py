"""A whole daemon with metrics, InfluxDB and a lake, whose process ``tell`` and whose server are killed."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from cellwatt.demo.cells import free_endpoint
from cellwatt.outlets.metrics.catalogue import CATALOGUE
from cellwatt.record import Recording
from tests.daemon.outlets.historian.server import influxd, real
from tests.patience import PATIENCE, eventually

pytestmark = [pytest.mark.slow, pytest.mark.system, pytest.mark.timeout(600)]
CHANNEL = "arm.joint_1.position"


@asynccontextmanager
async def process(*arguments: str, **more: Any) -> AsyncIterator[asyncio.subprocess.Process]:
    found = await asyncio.create_subprocess_exec(sys.executable, "-m", "cellwatt.commands", *arguments, **more)
    try:
        yield found
    finally:
        if found.returncode is None:
            found.terminate()
        await found.wait()


async def text_of(url: str) -> str:
    """What is served there; empty where nobody does."""
    try:
        async with aiohttp.ClientSession() as session, session.get(url, headers=OPEN_METRICS) as answer:
            return await answer.text() if answer.status == 200 else ""
    except aiohttp.ClientError:
        return ""


OPEN_METRICS = {"Accept": "application/openmetrics-text;version=1.0.0"}


async def metrics_of(at: str) -> dict[str, float]:
    """Values by metric and labels."""
    text = await text_of(f"http://{at}/metrics")
    families = list(text_string_to_metric_families(text)) if text else []
    assert all(family.name in CATALOGUE for family in families)
    return {f"{s.name}{sorted(s.labels.items())}": s.value for family in families for s in family.samples}


def teller(at: str) -> int:
    """Id of the process that serves the metrics."""
    port = int(at.rpartition(":")[2])
    return next(c.pid for c in psutil.net_connections() if c.laddr and c.laddr.port == port and c.status == "LISTEN")


@real
async def test_each_row_is_there_once_though_processes_are_killed(tmp_path: Path) -> None:
    (tmp_path / "influx").mkdir()
    arm, at = await asyncio.to_thread(lambda: (free_endpoint(), free_endpoint()))
    host, _, port = arm.partition(":")
    record, lake = tmp_path / "record", tmp_path / "lake"
    async with influxd(tmp_path / "influx") as server, process("emulate", "ur", "--listen", arm, stdout=-3):
        cell = {
            "site": "plant-1",
            "cell": "weld-3",
            "sources": {"arm": {"driver": "ur", "host": host, "port": int(port)}},
            "record": {"folder": str(record)},
            "metrics": {"listen": at},
            "historian": {
                "influx": {"url": server.url, "database": "plant", "rate": "5 Hz"},
                "lake": {"folder": str(lake), "rate": "10 Hz", "every": "2 s"},
            },
        }
        await asyncio.to_thread((tmp_path / "cell.yaml").write_text, json.dumps(cell))
        async with process("run", str(tmp_path / "cell.yaml"), stderr=-3) as daemon:
            await eventually(lambda: _rows(lake, 30), "the first rows", 4 * PATIENCE)
            before = await metrics_of(at)
            os.kill(await asyncio.to_thread(teller, at), signal.SIGKILL)
            await eventually(lambda: _rows(lake, 80), "rows after that", 4 * PATIENCE)
            await server.stop()
            await eventually(lambda: _rows(lake, 150), "rows while the server is away", 4 * PATIENCE)
            await server.start()
            await eventually(lambda: _rows(lake, 200), "rows after that", 4 * PATIENCE)
            after = await metrics_of(at)
            daemon.send_signal(signal.SIGTERM)
            await daemon.wait()
        received = "cellwatt_samples_received_total[('source', 'arm')]"
        assert after[received] > before[received] > 0
        async with process("run", str(tmp_path / "cell.yaml"), stderr=-3):
            sessions = await asyncio.to_thread(truths, record)
            first = next(iter(sessions))
            await eventually(lambda: _all(lake, sessions[first]), "the rest of the lake", 4 * PATIENCE)
            await eventually(lambda: _filled(server, sessions[first]), "the rest in InfluxDB", 4 * PATIENCE)
        written = {row["time"]: row[CHANNEL] for row in await server.query(f'SELECT "{CHANNEL}" FROM cellwatt')}
    rows = await asyncio.to_thread(lake_rows, lake)
    assert len(rows) == len({(row["session"], row["time"].value) for row in rows})
    kept = {row["time"].value: row[CHANNEL] for row in rows if row["session"] == first and row[CHANNEL] is not None}
    assert kept == pytest.approx(means(*sessions[first], 10**8))
    truth = means(*sessions[first], 2 * 10**8)
    assert {time: written[time] for time in truth} == pytest.approx(truth)


def lake_rows(lake: Path) -> list[dict[str, Any]]:
    columns = ["time", "session", CHANNEL]
    return [row for p in lake.glob("frames/**/*.parquet") for row in pq.ParquetFile(p).read(columns).to_pylist()]


async def _rows(lake: Path, count: int) -> bool:
    await asyncio.sleep(0.2)
    return len(await asyncio.to_thread(lake_rows, lake)) >= count


async def _all(lake: Path, frames: Any) -> bool:
    await asyncio.sleep(0.2)
    times = {row["time"].value for row in await asyncio.to_thread(lake_rows, lake)}
    return means(*frames, 10**8).keys() <= times


async def _filled(server: Any, frames: Any) -> bool:
    await asyncio.sleep(0.2)
    times = {row["time"] for row in await server.query(f'SELECT "{CHANNEL}" FROM cellwatt')}
    return means(*frames, 2 * 10**8).keys() <= times


def truths(record: Path) -> dict[int, Any]:
    """Times and values of the recorded frames by session."""
    found: dict[int, list[Any]] = {}
    recording = Recording.open(record)
    for path, (header, _, _) in zip(recording.paths, recording.spans, strict=True):
        found.setdefault(header.session, []).extend(Recording.open(path).frames())
    column = recording.layout.names.index(CHANNEL) if recording.layout else 0
    return {
        session: (np.concatenate([b.time for b in blocks]), np.concatenate([b.values[:, column] for b in blocks]))
        for session, blocks in found.items()
    }


def means(time: Any, values: Any, span: int) -> dict[int, float]:
    """Means by the end of their span, where there is any value."""
    number = -(-time // span)
    there = np.isfinite(values)
    return {int(n * span): float(values[(number == n) & there].mean()) for n in np.unique(number[there])}
