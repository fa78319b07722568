"""A cell in a real browser: a whole daemon with emulated devices, Chromium, and twenty readers of its stream.

    python bench/browser.py [--seconds 15]

Prints JSON: s from the request of the page to its first curve, bytes sent until then, frames a second with eight
channels and an hour shown, shares of a core that the process takes that serves, and raw samples that were lost.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import aiohttp
import psutil
from playwright.async_api import Browser

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.browser import chromium
from tests.system.running import Audience, Daemon
from tests.system.test_daemon import ur

from cellwatt.demo.cells import free_endpoint, shape_file
from cellwatt.emulation import EmulatorProcess
from cellwatt.record.reader import Recording

CHANNELS = ",".join(f"arm.joint_{joint}.{what}" for joint in range(1, 5) for what in ("position", "current"))
DRAWN = """() => [...document.querySelectorAll('.uplot canvas')].some((canvas) => {
    const {width, height} = canvas;
    if (!width || !height) return false;
    const data = canvas.getContext('2d').getImageData(0, 0, width, height).data;
    for (let i = 3; i < data.length; i += 4) if (data[i]) return true;
    return false;
})"""
"""True once something is drawn in a chart."""
FRAMES = """(ms) => new Promise((done) => {
    const times = [];
    const step = (now) => {
        times.push(now);
        if (now - times[0] < ms) return requestAnimationFrame(step);
        const gaps = times.slice(1).map((t, i) => t - times[i]).sort((a, b) => a - b);
        done({fps: 1000 * gaps.length / (times.at(-1) - times[0]), p99_ms: gaps[Math.floor(0.99 * gaps.length)]});
    };
    requestAnimationFrame(step);
})"""


def serving(daemon: Daemon) -> psutil.Process:
    """The process that serves the page."""
    assert daemon.process is not None
    family = psutil.Process(daemon.process.pid).children(recursive=True)
    return next(child for child in family if "cellwatt.outlets.page.serving" in child.cmdline())


async def share(process: psutil.Process, seconds: float) -> float:
    """Share of one core that a process takes, percent."""
    before, began = process.cpu_times(), time.monotonic()
    await asyncio.sleep(seconds)
    after = process.cpu_times()
    spent = after.user + after.system - before.user - before.system
    return round(100 * spent / (time.monotonic() - began), 1)


async def first_curve(browser: Browser, url: str) -> dict[str, float]:
    """s and bytes until the first curve is drawn, by a browser that has nothing of the page yet."""
    context = await browser.new_context(viewport={"width": 1440, "height": 900})
    page = await context.new_page()
    network = await context.new_cdp_session(page)
    await network.send("Network.enable")
    sent = 0

    def count(event: Any) -> None:
        nonlocal sent
        sent += event["encodedDataLength"]

    network.on("Network.dataReceived", count)
    began = time.monotonic()
    await page.goto(url, wait_until="commit")
    await page.wait_for_function(DRAWN, polling=20)
    found = {"first_curve_s": round(time.monotonic() - began, 3), "first_curve_bytes": sent}
    await context.close()
    return found


async def shown(browser: Browser, url: str, process: psutil.Process, seconds: float) -> dict[str, float]:
    """Frames a second in one browser, and what it costs the process that serves."""
    page = await browser.new_page(viewport={"width": 1440, "height": 900})
    await page.goto(f"{url}?span=3600&channels={CHANNELS}")
    await page.wait_for_function(DRAWN)
    await asyncio.sleep(2)
    frames = await page.evaluate(FRAMES, 1000 * seconds)
    cost = await share(process, seconds)
    await page.close()
    return {"fps": round(frames["fps"], 1), "gap_p99_ms": round(frames["p99_ms"], 1), "one_browser_percent": cost}


async def read(stream: str) -> None:
    connector = aiohttp.TCPConnector(force_close=True)
    async with aiohttp.ClientSession(connector=connector) as session, session.get(stream) as response:
        async for _ in response.content.iter_any():
            pass


async def measure(seconds: float) -> dict[str, Any]:
    address = free_endpoint()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        async with (
            EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm,
            EmulatorProcess("power_board", "--listen", "pty") as board,
        ):
            text = f"""
sources:
{ur("arm", arm.address)}  board: {{driver: power_board, port: {board.address}, rate: 123 Hz}}
stages: {{segment: {{arm: arm}}}}
page: {{listen: "{address}", arms: {{arm: {shape_file()}}}}}
"""
            async with Daemon(folder, text) as daemon, Audience(daemon, ("health", "event")) as audience:
                await audience.until(lambda a: a.all_up() and a.status["sinks"]["page"]["state"] == "ok")
                url, process = f"http://{address}/cell/test/test", serving(daemon)
                await asyncio.sleep(seconds)
                found: dict[str, Any] = {"no_browser_percent": await share(process, seconds)}
                async with chromium() as browser:
                    tries = [await first_curve(browser, url) for _ in range(5)]
                    found |= {f"{key}_of_five": sorted(one[key] for one in tries) for key in tries[0]}
                    found |= await shown(browser, url, process, seconds)
                stream = f"http://{address}/api/cells/test/test/stream?channels={CHANNELS}"
                readers = [asyncio.create_task(read(stream)) for _ in range(20)]
                await asyncio.sleep(2)
                found["twenty_readers_percent"] = await share(process, seconds)
                for reader in readers:
                    reader.cancel()
                await asyncio.gather(*readers, return_exceptions=True)
                found["serving_pss_mb"] = round(process.memory_full_info().pss / 1e6, 1)
                sources = audience.status["sources"].items()
                found["lost"] = {n: sum((*s["missed"].values(), *s["dropped"].values())) for n, s in sources}
                await daemon.stop()
        with Recording.open(folder / "record") as recording:
            samples = recording.batches("arm", "rtde")
            found["holes_in_the_record"] = int((samples.sequence[1:] - samples.sequence[:-1] != 1).sum())
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0)
    print(json.dumps(asyncio.run(measure(parser.parse_args().seconds)), indent=2))
