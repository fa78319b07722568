"""Draw docs/pictures/view-*.png: the page of the demo's cell with a spring on the arm's elbow, and a plant of 24 cells.

Devices are emulated, and so are the cells of the plant. It needs Chromium, and takes three minutes.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from bench.view import SITE, status
from playwright.async_api import Page, expect
from tests.browser import WAIT, chromium

from bench import watch
from cellwatt.demo.cells import free_endpoint
from cellwatt.outlets.zenoh.encode import JSON
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import health

SIZE = {"width": 1440, "height": 900}
CELLS = 24
MINUTE = 62.0
"""s until the chart of a minute is full."""


async def cell(folder: Path) -> None:
    address = free_endpoint()
    with watch.demo_cell(folder, f"spring:joint=3,at={watch.HOOKED:.0f}s", address):
        async with chromium() as browser:
            context = await browser.new_context(viewport=SIZE, color_scheme="light")
            page = await context.new_page()
            await _loaded(page, f"http://{address}/")
            await expect(page.locator("canvas.arm[data-suspect]")).to_be_visible(timeout=3 * WAIT)
            await asyncio.sleep(MINUTE - watch.HOOKED)
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
    endpoint, listen = f"tcp/{free_endpoint()}", free_endpoint()
    speaking = multiprocessing.get_context("spawn").Process(target=speak, args=(endpoint,))
    speaking.start()
    command = ("-m", "cellwatt.commands", "view", "--connect", endpoint, "--site", SITE, "--listen", listen)
    viewing = await asyncio.create_subprocess_exec(sys.executable, *command)
    try:
        async with chromium() as browser:
            page = await browser.new_page(viewport=SIZE, color_scheme="dark")
            await _loaded(page, f"http://{listen}/plant")
            await expect(page.locator(".tile")).to_have_count(CELLS, timeout=WAIT)
            await asyncio.sleep(5)
            await _shoot(page, "view-plant")
    finally:
        viewing.terminate()
        await viewing.wait()
        speaking.terminate()
        speaking.join()


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
    await page.screenshot(path=watch.PICTURES / f"{name}.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        asyncio.run(cell(Path(place)))
    asyncio.run(plant())
