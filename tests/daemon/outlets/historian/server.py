"""Servers that take line protocol: one that does what a test says, and Debian's InfluxDB as a process."""

from __future__ import annotations

import asyncio
import gzip
import json
import shutil
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from cellwatt.demo.cells import free_endpoint
from tests.daemon.outlets.historian.loopback import Loopback
from tests.daemon.outlets.historian.parsing import Point, parse
from tests.patience import eventually

INFLUXD = shutil.which("influxd") or shutil.which("/usr/bin/influxd")
real = pytest.mark.skipif(INFLUXD is None, reason="influxd is not installed (apt-get install influxdb)")


@dataclass
class Fake(Loopback):
    """Takes lines; ``answers`` are those to the next requests, ``refuses`` tells which lines it never takes."""

    answers: deque[tuple[int, str, dict[str, str]]] = field(default_factory=deque)
    refuses: Callable[[str], bool] = lambda _line: False
    down: bool = False
    requests: list[web.BaseRequest] = field(default_factory=list)
    batches: list[list[str]] = field(default_factory=list)
    points: dict[Any, Point] = field(default_factory=dict)

    async def take(self, request: web.BaseRequest) -> web.Response:
        body = await request.read()
        self.requests.append(request)
        if self.down:
            return web.Response(status=503)
        if self.answers:
            status, text, headers = self.answers.popleft()
            return web.Response(status=status, text=text, headers=headers)
        raw = (
            gzip.decompress(body)
            if request.headers.get("Content-Encoding") == "gzip" and body[:2] == b"\x1f\x8b"
            else body
        )
        lines = raw.decode().split("\n")
        self.batches.append(lines)
        bad = [line for line in lines if self.refuses(line)]
        for point in map(parse, (line for line in lines if line not in bad)):
            self.points[point.measurement, tuple(sorted(point.tags.items())), point.time] = point
        if bad:
            return web.json_response({"error": f"partial write: field type conflict dropped={len(bad)}"}, status=400)
        return web.Response(status=204)

    @property
    def rows(self) -> list[Point]:
        return sorted((p for p in self.points.values() if p.measurement == "cellwatt"), key=lambda p: p.time)


def fake() -> AbstractAsyncContextManager[Fake]:
    return Fake().open()


class Influxd:
    """An InfluxDB on loopback in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.at, self._rpc = free_endpoint(), free_endpoint()
        self.url = f"http://{self.at}"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        config = self.folder / "influxdb.conf"
        await asyncio.to_thread(config.write_text, self._config())
        log = await asyncio.to_thread((self.folder / "influxd.log").open, "ab")
        self._process = await asyncio.create_subprocess_exec(
            str(INFLUXD), "-config", str(config), stdout=log, stderr=log
        )
        log.close()
        await eventually(self.answers, "InfluxDB")

    async def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            await self._process.wait()
            self._process = None

    def _config(self) -> str:
        return f"""
reporting-disabled = true
bind-address = "{self._rpc}"
[meta]
dir = "{self.folder}/meta"
[data]
dir = "{self.folder}/data"
wal-dir = "{self.folder}/wal"
query-log-enabled = false
[monitor]
store-enabled = false
[http]
bind-address = "{self.at}"
log-enabled = false
"""

    async def answers(self) -> bool:
        try:
            async with aiohttp.ClientSession() as session, session.get(f"{self.url}/ping") as answer:
                return answer.status == 204
        except aiohttp.ClientError:
            return False

    async def query(self, text: str) -> list[dict[str, Any]]:
        """Rows that a query gives, times in ns."""
        params = {"db": "plant", "epoch": "ns", "q": text}
        async with aiohttp.ClientSession() as session, session.post(f"{self.url}/query", params=params) as answer:
            result = json.loads(await answer.text())["results"][0]
        assert "error" not in result, result
        return [
            dict(zip(series["columns"], row, strict=True)) | series.get("tags", {})
            for series in result.get("series", ())
            for row in series["values"]
        ]


@asynccontextmanager
async def influxd(folder: Path) -> AsyncIterator[Influxd]:
    found = await asyncio.to_thread(Influxd, folder)
    await found.start()
    try:
        await found.query("CREATE DATABASE plant")
        yield found
    finally:
        await found.stop()
