"""What the page costs: one cell at 50 Hz with 60 channels for 1 and for 20 browsers, and a plant of 200 cells.

    python bench/view.py [--seconds 20] [--cells 200]

Prints JSON: the share of one core that the process takes that serves, bytes before a browser can draw its first curve,
and what was dropped. Cells are emulated: the outlet is fed here, the plant's cells are Zenoh sessions of one process.
"""

from __future__ import annotations

import argparse
import asyncio
import gzip
import json
import multiprocessing
import socket
import sys
import time
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import psutil

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.outlets.page import PageOutlet, PageSettings
from cellwatt.outlets.zenoh.encode import JSON
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import health

SITE, CELL = "plant-1", "weld-3"
RATE, CHANNELS, SHOWN, BLOCK = 50.0, 60, 8, 5
LAYOUT = Layout(
    tuple(FrameChannel(f"arm.joint_{i}.position", "rad", "continuous", "linear") for i in range(CHANNELS)), RATE
)
WANTED = ",".join(LAYOUT.names[:SHOWN])


class View:
    """As much of a cell as the page asks for."""

    site, cell, folder, journal = SITE, CELL, Path(), None
    session = time.time_ns()
    record_folder = None


def status(cell: str) -> dict[str, Any]:
    counts = {"expected": 1, "received": 10**6, "missed": {"gap": 3}, "dropped": {}, "residue": 0, "counters": {}}
    source = {"state": "ok", "rate_hz": 500.0, "bound_ms": 1.5, "streams": {}, **counts}
    about = {"site": SITE, "cell": cell, "session": View.session, "state": "green", "time": time.time_ns()}
    sources = {f"source_{i}": source for i in range(4)}
    rest: dict[str, Any] = {"recorder": None, "frames": {"count": 0}, "results": 0, "alarms": [], "shelved": []}
    return {**about, "sources": sources, **rest}


async def feed(outlet: PageOutlet) -> None:
    sequence, began = 0, time.time_ns() // LAYOUT.step
    while True:
        numbers = np.arange(sequence, sequence + BLOCK)
        values = np.sin(numbers[:, None] / 50 + np.arange(CHANNELS))
        quality, bound = (np.zeros((BLOCK, CHANNELS), kind) for kind in (np.uint8, np.int64))
        outlet.offer(Frames(LAYOUT, sequence, (began + numbers) * LAYOUT.step, values, quality, bound))
        if sequence % round(RATE) == 0:
            outlet.health(status(CELL))
        sequence += BLOCK
        await asyncio.sleep((began + sequence) * LAYOUT.step * 1e-9 - time.time())


async def follow(url: str, read: dict[str, int]) -> None:
    """A browser that reads a stream; ``read`` counts its bytes and events."""
    connector = aiohttp.TCPConnector(force_close=True)
    async with aiohttp.ClientSession(connector=connector, read_bufsize=2**20) as browser, browser.get(url) as response:
        async for line in response.content:
            read["bytes"] += len(line)
            read["late"] = read.get("late", 0) + line.startswith(b"event: behind")


async def first_curve(url: str) -> dict[str, int]:
    """Bytes that a browser takes before it draws: the page and its files, its questions, and the first frames."""
    api, total, packed = f"{url}/api/cells/{SITE}/{CELL}", {}, {"Accept-Encoding": "gzip"}
    async with aiohttp.ClientSession(auto_decompress=False, headers=packed) as browser:
        async with browser.get(f"{url}/") as response:
            page = await response.read()
            text = gzip.decompress(page) if response.headers.get("Content-Encoding") == "gzip" else page
        files = {part.split(b'"')[0].decode() for part in text.split(b'="/assets/')[1:]}
        total["page and files"] = len(page)
        paths = {f"{url}/assets/{name}": "page and files" for name in files}
        paths |= {f"{url}/api/site": "questions", f"{api}/state": "questions"}
        paths |= {f"{api}/curves?channels={WANTED}&points=1200&from={time.time() * 1e3 - 6e4}": "curves of a minute"}
        for path, what in paths.items():
            async with browser.get(path) as response:
                total[what] = total.get(what, 0) + len(await response.read())
    return total


async def ended(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def share(process: psutil.Process, seconds: float) -> float:
    before, began = process.cpu_times(), time.monotonic()
    await asyncio.sleep(seconds)
    after = process.cpu_times()
    used = after.user + after.system - before.user - before.system
    return round(100 * used / (time.monotonic() - began), 2)


async def one_cell(seconds: float) -> dict[str, Any]:
    outlet = PageOutlet("page", PageSettings(listen="127.0.0.1:0"), View())  # type: ignore[arg-type]
    tasks = [asyncio.create_task(outlet.run()), asyncio.create_task(feed(outlet))]
    while outlet.url is None:  # noqa: ASYNC110
        await asyncio.sleep(0.1)
    url, (process,) = outlet.url.rstrip("/"), psutil.Process().children()
    stream = f"{url}/api/cells/{SITE}/{CELL}/stream?channels={WANTED}&rate=10"
    told: dict[str, Any] = {"core_percent": {}}
    reads: list[dict[str, int]] = []
    for browsers in (0, 1, 20):
        while len(reads) < browsers:
            reads.append({"bytes": 0})
            tasks.append(asyncio.create_task(follow(stream, reads[-1])))
        await asyncio.sleep(3.0)
        before = [read["bytes"] for read in reads]
        told["core_percent"][browsers] = await share(process, seconds)
        if browsers == 20:
            rates = [(read["bytes"] - b) / seconds / 1e3 for read, b in zip(reads, before, strict=True)]
            told["stream_kB_per_s"] = round(float(np.mean(rates)), 1)
    told["bytes_before_first_curve"] = await first_curve(url)
    told["pss_MB"] = round(process.memory_full_info().pss / 1e6, 1)
    told["told_late"] = sum(read.get("late", 0) for read in reads)
    told["dropped"] = {**outlet.account.dropped, **outlet.account.counters}
    await ended(tasks)
    return told


def speak(endpoint: str, cells: int) -> None:
    with open_session(LinkSettings(mode="router", listen=(endpoint,))) as session:
        keys = [CellKeys(SITE, f"cell-{i:03}") for i in range(cells)]
        tokens = [session.liveliness().declare_token(key.root) for key in keys]
        sequence = 0
        while tokens:
            for key in keys:
                mark = Mark(View.session, sequence, 1, time.time_ns())
                payload = health(mark, View.session, {}, status(key.cell))
                session.put(key.live("health"), payload, encoding=JSON, attachment=mark.encode(payload))
                time.sleep(1.0 / cells)
            sequence += 1


async def plant(cells: int, seconds: float) -> dict[str, Any]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    speaking = multiprocessing.get_context("spawn").Process(target=speak, args=(endpoint, cells))
    speaking.start()
    code = "from cellwatt.commands.view import command; command()"
    where = ("--connect", endpoint, "--site", SITE, "--listen", "127.0.0.1:0")
    viewing = await asyncio.create_subprocess_exec(sys.executable, "-c", code, *where, stdout=asyncio.subprocess.PIPE)
    assert viewing.stdout is not None
    url = (await viewing.stdout.readline()).decode().split(" at ")[1].strip().rstrip("/")
    told: dict[str, Any] = {"cells": cells, "core_percent": {}}
    reads: list[dict[str, int]] = []
    tasks: list[asyncio.Task[None]] = []
    for browsers in (1, 20):
        while len(reads) < browsers:
            reads.append({"bytes": 0})
            tasks.append(asyncio.create_task(follow(f"{url}/api/plant/stream", reads[-1])))
        await asyncio.sleep(5.0)
        told["core_percent"][browsers] = await share(psutil.Process(viewing.pid), seconds)
    async with aiohttp.ClientSession() as browser, browser.get(f"{url}/api/plant") as response:
        states = [cell["state"] for cell in (await response.json())["cells"]]
    told["heard"], told["green"] = len(states), states.count("green")
    told["told_late"] = sum(read.get("late", 0) for read in reads)
    await ended(tasks)
    viewing.terminate()
    await viewing.wait()
    speaking.terminate()
    speaking.join()
    return told


def main() -> None:
    """Measure both, and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--cells", type=int, default=200)
    asked = parser.parse_args()
    told = {"cell": asyncio.run(one_cell(asked.seconds)), "plant": asyncio.run(plant(asked.cells, asked.seconds))}
    print(json.dumps(told, indent=2))


if __name__ == "__main__":
    main()
