"""Draw docs/pictures/view-*.png: the demo's cell with a spring on an elbow, a plant, and a recording.

Devices are emulated, and so are the cells of the plant. It needs Chromium, and takes three minutes.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from playwright.async_api import Page, expect
from tests.browser import WAIT, chromium

from cellwatt.demo.cells import free_endpoint, shape_file
from cellwatt.outlets.zenoh.encode import JSON
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import health
from cellwatt.outlets.zenoh.reach import await_cell

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs/pictures"
SIZE = {"width": 1440, "height": 900}
HOOKED = 50
"""s after the start of the emulators at which the spring is hooked on."""
PATIENCE = 240.0
CELLS = 24
SITE, SESSION = "plant-1", time.time_ns()
MINUTE = 62.0
"""s until the chart of a minute is full."""


def status(cell: str) -> dict[str, Any]:
    counts = {"expected": 1, "received": 10**6, "missed": {"gap": 3}, "dropped": {}, "residue": 0, "counters": {}}
    source = {"state": "ok", "rate_hz": 500.0, "bound_ms": 1.5, "streams": {}, **counts}
    about = {"site": SITE, "cell": cell, "session": SESSION, "state": "green", "time": time.time_ns()}
    sources = {f"source_{i}": source for i in range(4)}
    rest: dict[str, Any] = {"recorder": None, "frames": {"count": 0}, "results": 0, "alarms": [], "shelved": []}
    return {**about, "sources": sources, **rest}


@contextmanager
def process(arguments: list[str], environment: Mapping[str, str], log: Path) -> Iterator[None]:
    """Run a command of cellwatt; end it afterwards."""
    command = [sys.executable, "-m", "cellwatt.commands", *arguments]
    with log.open("w") as out, subprocess.Popen(command, env=environment, stdout=out, stderr=out) as running:
        try:
            yield
        finally:
            running.terminate()


@contextmanager
def demo_cell(folder: Path, fault: str, page: str = "") -> Iterator[LinkSettings]:
    """The demo's cell, with a fault; ``page`` is the address of its page, any where it is empty."""
    endpoint = f"tcp/{free_endpoint()}"
    for name in ("demo.yaml", "demo-reference.yaml"):
        shutil.copy(ROOT / "examples" / name, folder)
    told = {
        "ENDPOINT": endpoint,
        "FOLDER": folder / "rec",
        "MODEL": ROOT / "daemon/cellwatt/demo/power.onnx",
    }
    told |= {"PAGE": page or free_endpoint(), "SHAPE": shape_file()}
    environment = {**os.environ, **{f"CELLWATT_DEMO_{name}": str(value) for name, value in told.items()}}
    live = folder / "live.yaml"
    emulate = ["emulate", "--cell", str(folder / "demo.yaml"), "--write", str(live), "--fault", fault]
    with process(emulate, environment, folder / "emulate.log"):
        while not live.exists():
            time.sleep(0.1)
        link = LinkSettings(mode="client", connect=(endpoint,))
        with process(["run", str(live)], environment, folder / "run.log"):
            await_cell(link, "demo", "demo", PATIENCE)
            yield link


async def cell(folder: Path) -> None:
    address = free_endpoint()
    with demo_cell(folder, f"spring:joint=3,at={HOOKED:.0f}s", address):
        async with chromium() as browser:
            context = await browser.new_context(viewport=SIZE, color_scheme="light")
            page = await context.new_page()
            await _loaded(page, f"http://{address}/")
            await expect(page.locator("canvas.arm[data-suspect]")).to_be_visible(timeout=3 * WAIT)
            await asyncio.sleep(MINUTE - HOOKED)
            await _shoot(page, "view-cell")
            await page.emulate_media(color_scheme="dark")
            await asyncio.sleep(1)
            await _shoot(page, "view-cell-dark")
            await page.emulate_media(color_scheme="light")
            await page.get_by_role("link", name="Alarms").first.click()
            await page.locator("[data-alarm*=_fault]").first.wait_for(timeout=WAIT)
            await asyncio.sleep(1)
            await _shoot(page, "view-alarms")


async def plant() -> None:
    endpoint = f"tcp/{free_endpoint()}"
    speaking = multiprocessing.get_context("spawn").Process(target=speak, args=(endpoint,))
    speaking.start()
    try:
        async with viewed("dark", "--connect", endpoint, "--site", SITE) as page:
            await expect(page.locator(".tile")).to_have_count(CELLS, timeout=WAIT)
            await asyncio.sleep(5)
            await _shoot(page, "view-plant")
    finally:
        speaking.terminate()
        speaking.join()


async def recording() -> None:
    async with viewed("light") as page:
        await page.set_viewport_size({"width": 1440, "height": 1720})
        await page.get_by_role("button", name="Open a sample").click()
        await page.locator("iframe").wait_for(timeout=WAIT)
        await page.get_by_role("button", name="Explain", exact=True).click()
        await page.locator("pre").wait_for(timeout=5 * WAIT)
        await page.evaluate("scrollTo(0, 0)")
        await _shoot(page, "view-recording")


@asynccontextmanager
async def viewed(scheme: Any, *arguments: str) -> AsyncIterator[Page]:
    """The page of ``cellwatt view`` in a browser."""
    listen = free_endpoint()
    command = ("-m", "cellwatt.commands", "view", *arguments, "--listen", listen)
    viewing = await asyncio.create_subprocess_exec(sys.executable, *command)
    try:
        async with chromium() as browser:
            page = await browser.new_page(viewport=SIZE, color_scheme=scheme)
            await _loaded(page, f"http://{listen}/")
            yield page
    finally:
        viewing.terminate()
        await viewing.wait()


def speak(endpoint: str) -> None:
    """Tell the health of many cells, some of which are not well."""
    with open_session(LinkSettings(mode="router", listen=(endpoint,))) as session:
        keys = [CellKeys(SITE, f"weld-{i + 1}") for i in range(CELLS)]
        tokens = [session.liveliness().declare_token(key.root) for key in keys]
        sequence = 0
        while tokens:
            for i, key in enumerate(keys):
                mark = Mark(1, sequence, 1, time.time_ns())
                payload = health(mark, 1, {}, told(i, key.cell))
                session.put(key.live("health"), payload, encoding=JSON, attachment=mark.encode(payload))
            sequence += 1
            time.sleep(1.0)


def told(number: int, cell: str) -> dict[str, Any]:
    power = 180.0 + 37.0 * (number * 7 % 11)
    body = {**status(cell), "power_W": power, "energy_today_J": power * 3600.0 * (4.0 + number % 5)}
    since = time.time_ns() - 600 * 10**9
    alarm = {"id": "a", "since": since, "severity": "error", "acknowledged": None}
    if number == 6:
        body["alarms"] = [{**alarm, "statement": "Joint 3 draws 34 W more than in healthy cycles (limit 9 W)."}]
    if number == 13:
        body["state"] = "amber"
        source = {**alarm, "severity": "warning", "statement": "Source board is down: no answer at /dev/ttyUSB0."}
        body["alarms"] = [source]
    if number == 19:
        known = {"name": "Ines", "note": "gear is ordered", "time": since}
        body["alarms"] = [{**alarm, "statement": "Joint 2 follows its path late.", "acknowledged": known}]
    return body


async def _loaded(page: Page, url: str) -> None:
    while True:
        with suppress(Exception):  # it is not served yet
            await page.goto(url)
            return
        await asyncio.sleep(0.5)


async def _shoot(page: Page, name: str) -> None:
    await page.screenshot(path=PICTURES / f"{name}.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        asyncio.run(cell(Path(place)))
    asyncio.run(plant())
    asyncio.run(recording())
