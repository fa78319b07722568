"""A cell in a browser: the arm moves, a spring turns a joint red, a person acknowledges, the daemon comes back."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from playwright.async_api import Page, expect

from cellwatt.demo.cells import SHAPE, free_endpoint
from cellwatt.demo.fault import JOINT
from cellwatt.runtime.acknowledgements import FILE
from tests.browser import WAIT, barriers, chromium, needs_chromium
from tests.patience import eventually
from tests.system.running import Audience, Daemon, hook_spring, judged_arm

pytestmark = [
    pytest.mark.system,
    pytest.mark.timeout(300),
    pytest.mark.blocks_loop,  # Playwright packs the half megabyte of axe in one step
    needs_chromium,
]

NOTE = "gear is ordered <img src=x onerror='window.strange = 1'><script>window.strange = 1</script>"
HEALTHY = 4500
"""Samples at 500 Hz until the elbow is watched."""


async def angle(page: Page, joint: int) -> str:
    """Reading of a joint beside the picture of the arm."""
    return await page.locator("ul.joints li").nth(joint - 1).locator(".value").inner_text()


async def acknowledge(page: Page, name: str, note: str) -> None:
    await page.get_by_role("link", name="Alarms").first.click()
    await page.locator("[data-alarm*=_fault]").first.get_by_role("button", name="Acknowledge").click()
    dialog = page.get_by_role("dialog")
    await dialog.get_by_label("Your name").fill(name)
    await dialog.get_by_label("Note").fill(note)
    await dialog.get_by_role("button", name="Acknowledge").click()
    await expect(dialog).to_have_count(0, timeout=WAIT)


@pytest.mark.slow
async def test_a_fault_is_seen_acknowledged_and_remembered(tmp_path: Path) -> None:
    epoch, address = time.time(), free_endpoint()
    async with (
        judged_arm(epoch) as (devices, text),
        Daemon(tmp_path, f'{text}page: {{listen: "{address}", arms: {{arm: {SHAPE}}}}}') as daemon,
        Audience(daemon) as audience,
        chromium() as browser,
    ):
        await audience.until(lambda a: a.all_up() and a.status["sinks"]["page"].get("url"))
        page = await browser.new_page()
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        await page.goto(f"http://{address}/")

        # The arm moves: its first joint is read at other angles.
        await expect(page.locator("canvas.arm")).to_be_visible(timeout=WAIT)
        await page.wait_for_function("() => document.querySelectorAll('ul.joints li').length === 6", timeout=WAIT)
        first = await angle(page, 1)
        await expect(page.locator("ul.joints li").first.locator(".value")).not_to_have_text(first, timeout=WAIT)
        await expect(page.locator("canvas.arm")).not_to_have_attribute("data-suspect", re.compile(".+"))

        # A spring on the elbow: that joint turns red, and no other.
        await audience.until(lambda a: a.received["raw/arm/rtde"] > HEALTHY)
        await hook_spring(devices, epoch, 1)
        suspect = page.locator(f"canvas.arm[data-suspect='{JOINT}']")
        await expect(suspect).to_be_visible(timeout=WAIT)
        assert "Suspected: joint 3" in (await suspect.get_attribute("aria-label") or "")

        assert await barriers(page) == []

        await acknowledge(page, "Ines", NOTE)
        await audience.until(lambda a: any(e.kind == "acknowledged" for e in a.events))
        said = next(e for e in audience.events if e.kind == "acknowledged")
        await eventually((tmp_path / "record" / FILE).exists, "the word to be on disk")
        assert said.data["name"] == "Ines" and said.data["note"] == NOTE

        await page.reload()
        card = page.locator("li[data-alarm*=_fault]").first
        await expect(card).to_contain_text("Acknowledged by Ines", timeout=WAIT)
        assert await barriers(page) == []
        age = card.locator(".about")
        await expect(age).not_to_have_text(await age.inner_text(), timeout=WAIT)
        history = page.get_by_role("group", name="History").get_by_role("table")
        await expect(history).to_contain_text("acknowledged by Ines", timeout=WAIT)
        await expect(page.get_by_text(NOTE).first).to_be_visible(timeout=WAIT)
        assert not await page.evaluate("window.strange")

        # The daemon is killed: the page says so, and goes on by itself when it is back. The spring is still there.
        await daemon.kill()
        await expect(page.get_by_text("Connection lost")).to_be_visible(timeout=WAIT)
        await daemon.start()
        await expect(page.get_by_text("Connection lost")).to_be_hidden(timeout=WAIT)
        await expect(page.locator("li.alarm.acknowledged[data-alarm*=_fault]").first).to_contain_text(
            "Acknowledged by Ines", timeout=2 * WAIT
        )
        assert not wrong, wrong
        assert await daemon.stop() == 0
