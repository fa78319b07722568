"""Debian's InfluxDB as a process."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
from tests.patience import eventually

from cellwatt.demo.cells import free_endpoint

INFLUXD = shutil.which("influxd") or shutil.which("/usr/bin/influxd")


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
