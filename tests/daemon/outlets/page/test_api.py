"""Every answer of the page, as its front end asks for it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import asdict

import aiohttp
import pytest

from cellwatt.outlets.page.app import FOLDER
from cellwatt.results import Event
from cellwatt.version import __version__
from tests.daemon.outlets.page.cell import (
    API,
    CELL,
    ENERGY,
    EPOCH,
    LAYOUT,
    MS,
    PREDICTION,
    SITE,
    TASK,
    Served,
    Stream,
    frames,
    get,
    interval,
    post,
    served,
    shelved,
    status,
)
from tests.daemon.outlets.zenoh.fake_cell import alarm


@pytest.fixture
async def page() -> AsyncIterator[Served]:
    async with served() as found:
        yield found


async def test_the_site_says_what_is_here_and_who_asks(browser: aiohttp.ClientSession, page: Served) -> None:
    told = await get(browser, page.url + "/api/site")
    assert len(told.pop("csrf")) == 64
    assert told == {
        "mode": "cell",
        "site": SITE,
        "cells": [{"site": SITE, "cell": CELL}],
        "user": None,
        "may_act": True,
        "may_drop": False,
        "login_needed": False,
        "version": __version__,
    }


async def test_every_page_is_the_same_application(browser: aiohttp.ClientSession, page: Served) -> None:
    for path in ("/", "/login", f"/cell/{SITE}/{CELL}/alarms", "/recordings/2"):
        async with browser.get(page.url + path) as response:
            assert (response.status, response.content_type) == (200, "text/html")
            assert await response.read() == (FOLDER / "index.html").read_bytes()
            assert response.headers["Cache-Control"] == "no-cache"
            tag = response.headers["ETag"]
    async with browser.get(page.url, headers={"If-None-Match": tag}) as response:
        assert (response.status, await response.read()) == (304, b"")


async def test_built_files_are_packed_and_kept_for_ever(page: Served) -> None:
    (file,) = FOLDER.glob("assets/*.js")
    url, content = f"{page.url}/assets/{file.name}", file.read_bytes()
    async with aiohttp.ClientSession(auto_decompress=False) as browser:
        async with browser.get(url, headers={"Accept-Encoding": "gzip"}) as response:
            assert response.headers["Cache-Control"] == "public, max-age=31536000, immutable"
            assert response.headers["Content-Encoding"] == "gzip"
            assert response.content_type == "text/javascript"
            assert len(await response.read()) < len(content) / 2
        async with browser.get(url, headers={"Accept-Encoding": "identity"}) as response:
            assert await response.read() == content
        async with browser.get(page.url + "/favicon.svg") as response:
            assert response.content_type == "image/svg+xml"


async def test_the_state_has_all_that_the_cell_told_in_ms(browser: aiohttp.ClientSession, page: Served) -> None:
    feed = page.feed
    feed.take_frames(frames(0, 2))
    for item in (interval(1), TASK, ENERGY, PREDICTION):
        feed.take_item(item)
    feed.take_item(alarm(1))
    feed.take_item(evidence("alarm-1", "weld-3_x.mcap"))
    known = {"name": "ada", "note": "seen", "time": EPOCH + 3_000_000}
    health = status([{**asdict(alarm(1)), "acknowledged": known}], [shelved(2)])
    feed.take_health(health)
    told = await get(browser, f"{page.url}{API}/state")
    assert told["time"] == MS + 10_000
    assert told["status"]["sources"]["arm"]["missed"] == {"gap": 2}
    assert 0 <= told["heard_age_s"] < 60
    assert told["channels"][2] == {"name": "arm.mode", "unit": "1", "kind": "discrete", "source": "arm"}
    assert told["intervals"] == [
        {"source": "arm", "number": 1, "start": MS + 1000, "end": MS + 1500, "moving": [1, 2], "closed": True}
    ]
    assert told["task"]["name"] == "task_1"
    assert (told["task"]["start"], told["task"]["end"]) == (MS, MS + 7000)
    (energy,) = told["energies"]["task_1"]
    assert (energy["total"], energy["groups"], energy["end"]) == (900.0, {"motion": 600.0}, MS + 7000)
    assert told["predictions"] == [{"model": "power", "outputs": {"power": "W"}}]
    (up,) = told["alarms"]
    assert up["acknowledged"] == {"name": "ada", "note": "seen", "time": MS + 3}
    assert (up["since"], up["time"], up["evidence"]) == (MS, MS + 1, {"residual_W": 12.5})
    assert up["evidence_page"] == f"{API}/reports/evidence/weld-3_x.html"
    assert told["shelved"] == [
        {
            "id": "alarm-2",
            "kind": "joint_fault",
            "severity": "error",
            "statement": "It squeaks.",
            "since": MS,
            "shelf": {"name": "ada", "note": "known", "time": MS + 1, "until": MS + 60_000, "severity": "error"},
        }
    ]


def evidence(alarm_id: str, pack: str) -> Event:
    return Event(EPOCH, "arm", "evidence", "kept", {"alarms": [alarm_id], "pack": pack})


async def test_a_stream_has_frames_and_all_events(browser: aiohttp.ClientSession, page: Served) -> None:
    page.feed.take_frames(frames(0, 1))
    page.feed.take_health(status())
    wanted = "arm.supply.power,arm.mode,nonsense"
    async with browser.get(f"{page.url}{API}/stream?channels={wanted}&rate=25") as response:
        assert response.content_type == "text/event-stream"
        stream = Stream(response)
        assert (await stream.until("health"))["state"] == "green"
        page.feed.take_frames(frames(5, 5))
        got = await stream.until("frames")
        assert got == {
            "t": [MS + 20 * n for n in range(5, 10)],
            "v": {
                "arm.supply.power": [105.0, 106.0, 107.0, 108.0, None],
                "arm.mode": [4e9 + n for n in range(5, 10)],
            },
            "q": {"arm.supply.power": 4, "arm.mode": 0},
        }
        feed = page.feed
        feed.take_item(PREDICTION)
        assert await stream.until("prediction") == {"model": "power", "t": [MS, MS + 20], "v": {"power": [101.0, None]}}
        feed.take_item(interval(3))
        assert (await stream.until("interval"))["number"] == 3
        feed.take_item(TASK)
        assert (await stream.until("task"))["repetition"] == 3
        feed.take_item(ENERGY)
        assert (await stream.until("energy"))["total"] == 900.0
        feed.take_item(alarm(1))
        assert (await stream.until("alarm"))["active"] is True
        feed.take_item(evidence("alarm-1", "x.mcap"))
        assert (await stream.until("event"))["t"] == MS
        assert (await stream.until("alarm"))["evidence_page"].endswith("/evidence/x.html")
        feed.take_health(status(shelved=[shelved(1)]))
        assert (await stream.until("shelved"))[0]["id"] == "alarm-1"
        feed.take_gap("3 of frame were lost: too late")
        assert await stream.until("gap") == {"text": "3 of frame were lost: too late"}


async def test_other_channels_end_the_stream_so_that_the_browser_asks_anew(
    browser: aiohttp.ClientSession, page: Served
) -> None:
    page.feed.take_frames(frames(0, 1))
    async with browser.get(f"{page.url}{API}/stream") as response:
        page.feed.take_frames(frames(1, 1, type(LAYOUT)(LAYOUT.channels[:2], 50.0)))
        with pytest.raises(EOFError):
            await Stream(response).until("never")


async def test_one_cell_is_a_plant_of_one(browser: aiohttp.ClientSession, page: Served) -> None:
    page.feed.take_health(status([{**asdict(alarm(1)), "acknowledged": None}], power_W=123.5))
    (cell,) = (await get(browser, page.url + "/api/plant"))["cells"]
    told = [cell[name] for name in ("state", "time", "sources_ok", "received", "lost", "power_W")]
    assert told == ["green", MS + 10_000, 1, 70, 3, 123.5]
    assert [(alarm["id"], alarm["acknowledged"]) for alarm in cell["alarms"]] == [("alarm-1", False)]
    await get(browser, page.url + "/api/plant/stream", 404)


async def test_what_cannot_be_answered_is_one_line(browser: aiohttp.ClientSession, page: Served) -> None:
    from yarl import URL

    missing = ("/nothing", "/api/cells/plant-1/weld-9/state", "/assets/../app.py", "/assets/..%2f..%2fapp.py")
    wrong = (
        f"{API}/stream?rate=nan",
        f"{API}/curves?from=5&to=1",
        f"{API}/alarms?from=5&to=9e13",
        f"{API}/curves?from=1e400",
        f"{API}/curves?channels={','.join(map(str, range(101)))}",
    )
    for path, code in {**dict.fromkeys(missing, 404), **dict.fromkeys(wrong, 400), "/api/login": 405}.items():
        async with browser.get(URL(page.url + path, encoded=True)) as response:
            assert response.status == code, path
            told = await response.json()
            assert list(told) == ["error"] and told["error"] and "\n" not in told["error"]


async def test_what_people_say_reaches_the_daemon(browser: aiohttp.ClientSession, page: Served) -> None:
    page.feed.take_health(status())
    body = {"id": "alarm-1", "name": " Ada\x1b[31m ", "note": "a new\nbelt is ordered"}
    assert await post(browser, page.url, f"{API}/acknowledge", body) == {}
    await post(browser, page.url, f"{API}/shelve", {"id": "alarm-1", "name": "Ada", "minutes": 30, "note": ""})
    await post(browser, page.url, f"{API}/unshelve", {"id": "alarm-2", "name": "Ada"})
    first, second, third = page.orders
    assert first == {"what": "acknowledge", "alarm": "alarm-1", "name": "Ada [31m", "note": "a new belt is ordered"}
    assert second["until"] == status()["time"] + 30 * 60 * 10**9, "by the clock of the cell, not of the PC"
    assert third == {"what": "unshelve", "alarm": "alarm-2", "name": "Ada", "note": ""}


async def test_what_people_say_wrongly_does_nothing(browser: aiohttp.ClientSession, page: Served) -> None:
    one, ada = {"id": "alarm-1"}, {"name": "Ada", "note": ""}
    for what, body, code, error in (
        ("acknowledge", {**ada, "id": 5}, 400, "id: expected a text"),
        ("acknowledge", {**one, **ada, "note": "x" * 1001}, 400, "note: expected a text of at most"),
        ("shelve", {**one, **ada}, 400, "minutes: expected a number"),
        ("shelve", {**one, **ada, "minutes": True}, 400, "minutes: expected a number"),
        ("shelve", {**one, **ada, "minutes": 1e9}, 400, "minutes: expected a number"),
        ("acknowledge", [1], 400, "expected a JSON object"),
        ("acknowledge", {"id": "x" * 20000}, 413, ""),
    ):
        assert error in (await post(browser, page.url, f"{API}/{what}", body, code))["error"]
    assert page.orders == []
