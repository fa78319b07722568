"""The outlet with the process that really serves: told, ordered about, killed."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import aiohttp
import psutil
import pytest

from cellwatt import Event, OutletError
from cellwatt.outlets.apart import outlet as outlet_module
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.page import PageOutlet, PageSettings
from cellwatt.outlets.page.sessions import FILE
from cellwatt.results import Result
from cellwatt.runtime.delivery import Delivery
from tests.daemon.outlets.page.cell import (
    API,
    EPOCH,
    HASH,
    PREDICTION,
    USERS,
    Stream,
    View,
    client,
    frames,
    get,
    log_in,
    post,
    status,
)
from tests.daemon.outlets.serving import children, serving
from tests.daemon.outlets.zenoh.fake_cell import Journal, alarm, batch
from tests.daemon.outlets.zenoh.processes import free_port
from tests.doing import doing
from tests.patience import eventually


@pytest.fixture
def view(tmp_path: Path) -> View:
    return View(tmp_path)


def outlet_of(view: View, **settings: Any) -> PageOutlet:
    return PageOutlet("page", PageSettings(**{"listen": "127.0.0.1:0", **settings}), view)


async def test_what_the_cell_tells_reaches_a_browser(view: View) -> None:
    told = (alarm(2), replace(alarm(3), active=False), PREDICTION)
    view.journal = Journal(*told)  # type: ignore[assignment]
    outlet = outlet_of(view)
    async with client() as browser:
        async with serving(outlet) as url:
            outlet.health(status([asdict(alarm(2))]))
            outlet.offer(replace(PREDICTION, time=None))  # one that cannot be shown costs only itself
            outlet.offer(replace(PREDICTION, units=lambda: None))  # so does one that cannot be encoded
            outlet.offer(frames(0, 5))
            await eventually(lambda: outlet.account.received == 6, "the frames")
            response = await browser.get(f"{url}{API}/stream?channels=arm.mode&rate=25")
            stream = Stream(response)
            await stream.until("health")
            outlet.offer(frames(5, 5))
            outlet.offer(alarm(1))
            outlet.offer(batch(0, 5))
            outlet.offer(Event(EPOCH, "arm", "connected", "UR10e"))
            got = dict([await stream.next() for _ in range(3)])
            assert got["frames"]["v"]["arm.mode"] == [4e9 + n for n in range(5, 10)]
            assert got["alarm"]["id"] == "alarm-1"
            assert got["event"]["text"] == "UR10e"
            told = await get(browser, f"{url}{API}/state")
            assert (told["session"], told["record"], len(told["channels"])) == (EPOCH / 1e6, False, 3)
            assert [a["id"] for a in told["alarms"]] == ["alarm-2", "alarm-1"]
            await eventually(lambda: outlet.account.counters["messages not shown"] == 1, "what was not shown")
        with pytest.raises((EOFError, aiohttp.ClientError)):
            await stream.until("never")
        response.close()
    assert (outlet.account.received, outlet.account.residue, outlet.url) == (13, 0, None)
    assert outlet.account.dropped == {"not encodable": 1}


def test_what_is_offered_while_the_past_is_read_is_told_once(view: View) -> None:
    class Meanwhile(Journal):
        def past(self) -> Iterator[tuple[int, Result | Event]]:
            outlet.offer(alarm(1))
            return super().past()

    view.journal = Meanwhile(alarm(1), alarm(2))  # type: ignore[assignment]
    outlet = outlet_of(view)
    assert outlet._past() == [alarm(2)], "the other waits"


async def test_what_people_order_is_done_in_the_daemon(view: View) -> None:
    outlet = outlet_of(view)
    async with serving(outlet) as url, client() as browser:
        before, about = time.time_ns(), {"id": "alarm-1", "name": "Ada", "note": "seen"}
        await post(browser, url, f"{API}/acknowledge", about)
        await post(browser, url, f"{API}/shelve", {**about, "minutes": 10})
        await post(browser, url, f"{API}/unshelve", about)
        refused = await post(browser, url, f"{API}/acknowledge", {**about, "id": "alarm-13"}, 409)
        assert refused == {"error": "no alarm 'alarm-13' is active: it may have been cleared"}
    acknowledged, shelved, unshelved = view.ordered
    assert (acknowledged, unshelved) == (("acknowledge", "alarm-1", "Ada", "seen"), ("unshelve", "alarm-1", "Ada"))
    assert shelved[:2] == ("shelve", "alarm-1")
    assert before + 600e9 <= shelved[2] <= time.time_ns() + 600e9
    assert outlet.account.counters["acknowledge by a person"] == 1


async def test_logins_survive_a_restart_and_secrets_are_nowhere_to_be_seen(view: View, tmp_path: Path) -> None:
    view.record_folder = record = tmp_path / "rec"
    record.mkdir()
    outlet = outlet_of(view, users=USERS, listen=f"127.0.0.1:{free_port()}")
    async with client() as browser:
        async with serving(outlet) as url:
            (child,) = await asyncio.to_thread(children, PageOutlet.module)
            command, environment = child.cmdline(), await asyncio.to_thread(child.environ)
            assert HASH not in " ".join([*command, *environment.values()])
            assert await asyncio.to_thread(child.nice) == max(10, os.nice(0))
            assert await log_in(browser, url, "ada") == 200
        assert (record / FILE).stat().st_mode & 0o777 == 0o600
        async with serving(outlet) as url:
            await get(browser, f"{url}{API}/state")


async def test_a_port_that_is_taken_is_named(view: View) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        listen = f"127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(OutletError, match=f"^{listen} is in use: choose another port"):
            await outlet_of(view, listen=listen).run()


async def test_a_process_that_is_killed_is_started_again(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.runtime.delivery.FIRST_PAUSE", 0.01)
    outlet = outlet_of(view)
    delivery = Delivery("page", lambda: outlet)
    assert delivery.status()["state"] == "starting"
    async with doing(delivery.run()):
        await eventually(lambda: outlet.url, "the page")
        assert delivery.status()["state"] == "ok"
        (child,) = await asyncio.to_thread(children, PageOutlet.module)
        child.kill()
        await eventually(lambda: delivery.status()["error"], "its end")
        told = delivery.status()
        assert (told["state"], told["error"]) == ("down", "the process that serves the page ended (by SIGKILL)")
        await eventually(lambda: outlet.url, "the page again")
        delivery.offer(frames(0, 5))
        await eventually(lambda: outlet.account.received == 5, "frames again")
        async with client() as browser:
            await get(browser, f"{outlet.url}api/site")


async def test_a_process_that_hangs_is_told_and_holds_up_nobody(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlet_module, "BLOCKS", 20)
    monkeypatch.setattr(outlet_module, "SILENT", 0.3)
    monkeypatch.setattr("cellwatt.outlets.apart.wire.END", 0.1)
    outlet = outlet_of(view)
    async with serving(outlet):
        (child,) = await asyncio.to_thread(children, PageOutlet.module)
        assert outlet.trouble() is None
        child.send_signal(signal.SIGSTOP)
        offered = 0
        while not outlet.account.dropped:
            outlet.offer(frames(offered, 500))
            outlet.offer(alarm(1))
            offered += 500
            await asyncio.sleep(0)
        assert set(outlet.account.dropped) == {"queue: frames"}
        await eventually(outlet.trouble, "that it is silent")
        assert "has not responded for" in str(outlet.trouble())
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE
    assert outlet.account.dropped.total() > 0


@pytest.mark.parametrize(("kind", "told"), [(Kind.ORDER, []), (Kind.ALIVE, {"counts": ["a"]}), (Kind.ORDER, {})])
async def test_a_process_that_speaks_nonsense_is_told(view: View, kind: Kind, told: Any) -> None:
    reader = asyncio.StreamReader()
    reader.feed_data(wire.from_process(kind, told))
    reader.feed_eof()
    with pytest.raises(OutletError, match="sent an invalid message"):
        await outlet_of(view)._listen(reader, None)  # type: ignore[arg-type]
