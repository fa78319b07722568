"""All cells of a site over real Zenoh sessions, each an outlet that publishes as a daemon's does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any

import aiohttp
import pyarrow  # noqa: F401  # so that no loop waits for its import
import pytest

from cellwatt.outlets.page import plant as plant_module
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.serving import view
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from tests.daemon.outlets.page.cell import EPOCH, MS, Stream, client, get, post, status
from tests.daemon.outlets.zenoh.fake_cell import FakeView, alarm, frames
from tests.daemon.outlets.zenoh.serving import serving
from tests.doing import doing
from tests.patience import eventually

SITE = "plant-1"


@asynccontextmanager
async def speaking(cell: str, router: str, told: dict[str, Any]) -> AsyncIterator[ZenohOutlet]:
    """A cell that publishes, with its health ten times a second as ``told`` has it."""
    outlet = ZenohOutlet("zenoh", ZenohSettings(mode="client", connect=(router,)), FakeView(cell=cell))
    async with serving(outlet, told):
        yield outlet


@asynccontextmanager
async def viewing(router: str, cell: str | None = None) -> AsyncIterator[str]:
    """The address of a page by itself."""
    told: list[str] = []
    link = LinkSettings(mode="client", connect=(router,))
    settings = PageSettings(listen="127.0.0.1:0")
    async with doing(view(settings, link, SITE, cell, None, None, told.append)) as running:
        await eventually(lambda: told or running.done(), "the page")
        yield told[0].removeprefix("the page is at ").rstrip("/")


@pytest.fixture
def router(bus: LinkSettings) -> str:
    return bus.connect[0]


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_module, "LOOK", 0.1)


async def cells(browser: aiohttp.ClientSession, url: str) -> dict[str, Any]:
    return {cell["cell"]: cell for cell in (await get(browser, f"{url}/api/plant"))["cells"]}


async def test_all_cells_of_the_site_are_shown_with_their_states(router: str) -> None:
    up = {**asdict(alarm(1)), "acknowledged": {"name": "ada", "note": "", "time": EPOCH}}
    states = {
        "weld-1": status(),
        "weld-2": status([up], state="red", power_W=812.5, energy_today_J=9e6, task="task_1"),
        "weld-3": {"state": "green"},
    }
    async with AsyncExitStack() as stack:
        url = await stack.enter_async_context(viewing(router))
        browser = await stack.enter_async_context(client())
        for name, told in states.items():
            await stack.enter_async_context(speaking(name, router, told))

        async def all_answer() -> Any:
            found = await cells(browser, url)
            return len(found) == 3 and all(cell["state"] for cell in found.values()) and found

        found = await eventually(all_answer, "all three")
        assert [cell["state"] for cell in found.values()] == ["green", "red", "green"]
        assert (found["weld-1"]["received"], found["weld-1"]["lost"]) == (70, 3)
        red = found["weld-2"]
        assert red["alarms"][0] == {
            "id": "alarm-1",
            "severity": "error",
            "since": MS,
            "statement": "Joint 1 needs more power than it should.",
            "acknowledged": True,
        }
        assert (red["power_W"], red["energy_today_J"], red["task"]) == (812.5, 9e6, "task_1")
        assert red["age_s"] < 60
        site = await get(browser, f"{url}/api/site")
        assert (site["mode"], site["site"], len(site["cells"])) == ("plant", SITE, 3)


async def test_a_cell_comes_and_goes_in_the_stream(router: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async with viewing(router) as url, client() as browser, browser.get(f"{url}/api/plant/stream") as response:
        stream = Stream(response)
        assert await stream.until("plant") == {"cells": []}

        async def state(wanted: str) -> None:
            while not any(cell["state"] == wanted for cell in (await stream.until("plant"))["cells"]):
                pass

        async with speaking("weld-1", router, status()):
            await asyncio.wait_for(state("green"), 30)
        await asyncio.wait_for(state("gone"), 30)
        assert (await cells(browser, url))["weld-1"]["state"] == "gone"
        monkeypatch.setattr(plant_module, "FORGOTTEN", 0.0)
        with pytest.raises(EOFError):  # so that browsers drop its tile
            await asyncio.wait_for(state("forgotten"), 30)
        assert await cells(browser, url) == {}


async def test_a_cell_that_is_looked_at_is_followed_and_then_left(router: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.page.plant.KEPT", 0.2)
    told = status([asdict(alarm(1))])
    async with speaking("weld-1", router, told) as cell, viewing(router) as url, client() as browser:
        await eventually(lambda: in_plant(browser, url, "weld-1"), "the cell")
        api = f"{url}/api/cells/{SITE}/weld-1"
        async with browser.get(f"{api}/stream?channels=arm.joint_1.position&rate=25") as response:

            async def offering() -> None:
                for first in count(0, 5):
                    cell.offer(frames(first, 5))
                    await asyncio.sleep(0.05)

            async with doing(offering()):
                got = await Stream(response).until("frames")
            first = got["v"]["arm.joint_1.position"][0]
            assert first % 1 == 0.25
            assert got["t"][0] == MS + 20 * (first - 0.25)

            async def alarmed() -> Any:
                told = await get(browser, f"{api}/state")
                return told["alarms"] and told

            told = await eventually(alarmed, "its alarm")
            assert [a["id"] for a in told["alarms"]] == ["alarm-1"]
            assert (told["may_act"], told["record"]) == (False, False)
            told = await get(browser, f"{api}/curves?channels=arm.joint_1.position&from={MS}&to={MS + 60000}")
            assert told["from_record"] is False
            assert told["v"]["arm.joint_1.position"]["min"][-1] is not None
        body = {"id": "alarm-1", "name": "Ada", "note": ""}
        refused = await post(browser, url, f"/api/cells/{SITE}/weld-1/acknowledge", body, 403)
        assert refused == {"error": "acknowledge on the cell's own page"}
        watching = lambda: [t for t in asyncio.all_tasks() if "watch" in repr(t.get_coro())]  # noqa: E731
        await eventually(lambda: not watching(), "nobody follows it any more")


async def in_plant(browser: aiohttp.ClientSession, url: str, name: str) -> bool:
    return name in await cells(browser, url)


async def test_a_few_cells_are_followed_at_a_time_and_one_by_itself(
    router: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cellwatt.outlets.page.plant.MOST_OPEN", 1)
    async with (
        speaking("weld-1", router, status([asdict(alarm(1))])),
        speaking("weld-2", router, status()),
        viewing(router) as url,
        viewing(router, "weld-1") as own,
        client() as browser,
    ):

        async def alarms() -> Any:
            return (await get(browser, f"{own}/api/cells/{SITE}/weld-1/state"))["alarms"]

        assert (await eventually(alarms, "the alarm"))[0]["id"] == "alarm-1"
        told = await get(browser, f"{own}/api/site")
        assert (told["mode"], told["cells"]) == ("cell", [{"site": SITE, "cell": "weld-1"}])
        await eventually(lambda: in_plant(browser, url, "weld-1"), "the cell")
        await eventually(lambda: in_plant(browser, url, "weld-2"), "the other")
        await get(browser, f"{url}/api/cells/{SITE}/weld-1/state")
        assert "1 cells are open" in (await get(browser, f"{url}/api/cells/{SITE}/weld-2/state", 503))["error"]
        for where in (f"{SITE}/weld-9", "plant-2/weld-1"):
            await get(browser, f"{url}/api/cells/{where}/state", 404)


async def test_nonsense_in_a_cells_name_costs_only_that_cell(router: str, tmp_path: Path) -> None:
    stranger = await asyncio.to_thread(open_session, LinkSettings(mode="client", connect=(router,)))
    try:
        async with speaking("weld-1", router, status()), viewing(router) as url, client() as browser:
            await eventually(lambda: in_plant(browser, url, "weld-1"), "the cell")

            async def nonsense() -> bool:
                for payload in (b"", b"[]", b'{"positions": {}, "session": 1, "time": 1, "status": {"alarms": 5}}'):
                    stranger.put(f"cellwatt/{SITE}/odd/health", payload)
                async with browser.get(f"{url}/api/cells/{SITE}/odd/state") as response:
                    assert response.status in (200, 404)
                found = await cells(browser, url)
                return "odd" in found and found["odd"]["state"] is None and found["weld-1"]["state"] == "green"

            await eventually(nonsense, "both cells")
    finally:
        await asyncio.to_thread(stranger.close)
