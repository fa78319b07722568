"""The page over a real record: curves, alarms and reports through HTTP, with what is newer from memory."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest

from cellwatt import OutletError
from cellwatt.outlets.page.archive import THREADS, WAITING, Archive, Desk
from cellwatt.outlets.page.cells import follow_arms
from cellwatt.report import Provenance, Report
from tests.daemon.outlets.page import cell, recorded
from tests.daemon.outlets.page.cell import API, Served, get, served
from tests.daemon.outlets.page.recorded import MS, SESSION, STEP, S, alarm, frames, interval, recording
from tests.patience import eventually

START = SESSION + 10 * S
END = START + 20 * S


def block(first: int, count: int) -> Any:
    numbers = np.arange(first, first + count)
    return frames(START + numbers * STEP, np.sin(numbers / 7))


def written(folder: Path) -> Path:
    """20 s of frames of which the last second is not in the record."""
    rec = folder / "rec"
    rec.mkdir()
    up = alarm("a", START + S, START + 2 * S)
    recording(rec, [[block(0, 950), interval(1, START + S, START + 2 * S), up]])
    report = Report("ur10e", "simulation and recordings", [], "It misses a spring.", [], provenance=Provenance.here())
    report.write(rec / "explained.html")
    return rec


@pytest.fixture
async def page(tmp_path: Path) -> AsyncIterator[Served]:
    desk = Desk()
    archive = Archive(await asyncio.to_thread(written, tmp_path), recorded.CELL, None, desk)
    await asyncio.to_thread(archive.start)
    async with served(archive=archive) as found:
        yield found
    await asyncio.to_thread(archive.close)
    await asyncio.to_thread(desk.close)


@pytest.mark.parametrize("points", [2000, 100])
async def test_curves_go_on_from_the_record_into_memory(
    browser: aiohttp.ClientSession, page: Served, points: int
) -> None:
    for first in range(800, 1000, 5):
        page.feed.take_frames(block(first, 5))
    asked = f"channels=arm.power&from={START / MS}&to={END / MS}&points={points}"
    got = await get(browser, f"{page.url}{API}/curves?{asked}")
    assert (got["from_record"], got["complete"]) == (True, True)
    assert len(got["t"]) <= points
    exact, step = np.sin(np.arange(1000) / 7), got["step_ms"]
    curve = got["v"]["arm.power"]
    times = np.array(got["t"]) - START / MS
    for place, time in enumerate(times):
        rows = exact[max(0, int(np.ceil(round(time / 20, 3)))) : int(np.ceil(round((time + step) / 20, 3)))]
        if not len(rows):
            continue
        assert curve["min"][place] == pytest.approx(rows.min(), abs=1e-6)
        assert curve.get("max", curve["min"])[place] == pytest.approx(rows.max(), abs=1e-6)
    assert times[-1] + step >= 19_980
    assert [i["number"] for i in got["intervals"]] == [1]
    assert [a["id"] for a in got["alarms"]] == ["a"]


async def test_alarms_and_reports_of_the_record(browser: aiohttp.ClientSession, page: Served) -> None:
    told = await get(browser, f"{page.url}{API}/alarms?from={START / MS}&to={END / MS}")
    assert [(a["id"], a["cleared"], a["people"]) for a in told["alarms"]] == [("a", None, [])]
    assert (await get(browser, f"{page.url}{API}/state"))["record"] is True
    (report,) = (await get(browser, f"{page.url}{API}/reports"))["reports"]
    assert (report["finding"], report["href"]) == ("It misses a spring.", f"{API}/reports/explained.html")
    assert (await get(browser, f"{page.url}{API}/mismatch"))["href"] == report["href"]
    async with browser.get(page.url + report["href"]) as response:
        assert response.status == 200
        assert response.headers["Content-Security-Policy"].startswith("sandbox allow-scripts; default-src 'none';")
        assert "It misses a spring." in await response.text()
    for path in ("../secret.html", "..%2fsecret.html", "none.html", "rec"):
        async with browser.get(f"{page.url}{API}/reports/{path}") as response:
            assert response.status == 404


async def test_questions_about_the_past_hold_up_nobody() -> None:
    import threading

    desk, over = Desk(), threading.Event()
    try:
        slow = [asyncio.create_task(desk.ask(over.wait)) for _ in range(THREADS + WAITING)]
        await asyncio.sleep(0)
        with pytest.raises(OutletError, match="too many requests for past data are waiting"):
            await desk.ask(over.wait)
        slow[-1].cancel()  # a browser that leaves
        over.set()
        assert await asyncio.gather(*slow[:-1]) == [True] * (THREADS + WAITING - 1)
        assert await desk.ask(lambda: 5) == 5
    finally:
        over.set()
        await asyncio.to_thread(desk.close)


URDF = """<robot name="one"><link name="base"/><link name="arm"/><joint name="turn" type="revolute">
<parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/></joint></robot>"""


async def test_arms_are_shown_once_their_channels_are_known(
    browser: aiohttp.ClientSession, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    await asyncio.to_thread((tmp_path / "one.urdf").write_text, URDF)
    async with served() as page:
        arms = {"arm": tmp_path / "one.urdf", "other": tmp_path / "none.urdf"}
        following = asyncio.create_task(follow_arms(page.feed, arms))
        assert (await get(browser, f"{page.url}{API}/state"))["arms"] == []
        page.feed.take_frames(cell.frames(0, 1))
        await eventually(lambda: page.feed.arms, "the arm")
        (arm,) = (await get(browser, f"{page.url}{API}/state"))["arms"]
        (joint,) = arm["joints"]
        assert (joint["channel"], joint["type"], joint["parent"]) == ("arm.joint_1.position", "revolute", -1)
        assert page.feed.joints == ["arm.joint_1.position"]
        following.cancel()
    assert "the arm of other is not shown" in caplog.text
