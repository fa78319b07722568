"""Outlets that fail, break, end or hang: neither the sources nor the other outlets feel it, and health says so."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from cellwatt import OutletError
from cellwatt.runtime.delivery import Delivery
from cellwatt.runtime.troubles import Monitor
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    RECEIVERS,
    FakeOutlet,
    ReceiverSettings,
    answer,
    config_of,
    fail,
    give,
    last,
    look,
    outlets,
    running,
    until,
)

AWAY = OutletError("no router at tcp/192.0.2.1:7447")


async def runs(n):
    """Times, s, between the runs of the outlet."""
    await until(lambda: len(RECEIVERS["bus"].runs) >= n)
    times = RECEIVERS["bus"].runs[:n]
    return [b - a for a, b in pairwise(times)]


@at_once
async def test_an_outlet_that_fails_is_run_again_with_longer_pauses():
    RECEIVERS["bus"].tell(*[fail(AWAY)] * 8)
    async with running(config_of()):
        assert await runs(9) == pytest.approx([0.5, 1, 2, 4, 8, 16, 30, 30])


@at_once
async def test_an_outlet_that_served_is_run_again_soon():
    RECEIVERS["bus"].tell(*[fail(AWAY)] * 6, last(60.0), fail(AWAY))
    async with running(config_of()):
        assert (await runs(8))[-2:] == pytest.approx([16, 60.5])


@at_once
async def test_an_outlet_is_down_until_it_has_served_for_a_while():
    RECEIVERS["bus"].tell(fail(AWAY))
    async with running(config_of()) as cell:
        await runs(2)
        bus = (await look(cell))["sinks"]["bus"]
        assert (bus["state"], bus["error"]) == ("down", str(AWAY)), "it may be about to fail again"
        await asyncio.sleep(10.0)
        assert (await look(cell))["sinks"]["bus"]["state"] == "down"
        await asyncio.sleep(10.0)
        bus = (await look(cell))["sinks"]["bus"]
        assert (bus["state"], bus["error"]) == ("ok", None)


@at_once
async def test_an_outlet_that_takes_long_to_fail_is_one_alarm():
    RECEIVERS["bus"].tell(*[last(10.0), fail(AWAY)] * 10)
    delivery = Delivery("bus", lambda: FakeOutlet("bus", ReceiverSettings(), None))
    task = asyncio.create_task(delivery.run())
    watch, alarms = Monitor(), []
    for _ in range(130):
        await asyncio.sleep(1.0)
        status = {"sources": {}, "stages": {}, "sinks": {"bus": delivery.status()}, "recorder": None}
        alarms += watch.look(status, 0)
    task.cancel()
    await asyncio.wait([task])
    assert [(a.id, a.active, a.statement) for a in alarms] == [("sink_down:bus", True, f"Outlet bus is down: {AWAY}")]


@pytest.mark.parametrize(
    ("order", "error"),
    [
        (fail(KeyError("topic")), "KeyError: 'topic'"),
        (fail(asyncio.CancelledError()), "CancelledError: "),
    ],
)
@at_once
async def test_an_outlet_with_a_mistake_is_run_again(caplog, order, error):
    RECEIVERS["bus"].tell(order)
    async with running(config_of()) as cell:
        await runs(2)
        assert (await look(cell))["sinks"]["bus"]["error"] == error
    assert "outlet bus failed" in caplog.text


@at_once
async def test_an_outlet_that_ends_by_itself_is_down_and_run_again(monkeypatch):
    async def ends(_):
        RECEIVERS["bus"].runs.append(0.0)

    monkeypatch.setattr(FakeOutlet, "run", ends)
    async with running(config_of()) as cell:
        await runs(3)
        assert (await look(cell))["sinks"]["bus"]["error"] == "it ended without being stopped"


@at_once
async def test_an_outlet_that_breaks_at_what_it_is_offered_breaks_nothing_else(caplog):
    RECEIVERS["bus"].refuse = TypeError("cannot\x00encode")
    DEVICES["arm"].tell(answer, give(20))
    async with running(config_of(outlets=outlets("bus", "other"))) as cell:
        await DEVICES["arm"].done()
        status = await look(cell)
        assert status["sources"]["arm"]["state"] == "ok"
        assert len(DEVICES["arm"].runs) == 1, "the source is not to blame"
        bus = status["sinks"]["bus"]
        assert (bus["state"], bus["error"]) == ("down", "TypeError: cannot encode")
        assert bus["counters"]["items lost"] >= 20
        assert RECEIVERS["other"].values == list(range(20))
        assert len(RECEIVERS["other"].frames) >= 19
        RECEIVERS["bus"].refuse = None
        assert (await look(cell, 2))["sinks"]["bus"]["state"] == "ok"
    assert caplog.text.count("outlet bus failed") == 1, "told once"


@at_once
async def test_an_outlet_that_breaks_at_health_does_not_keep_it_from_others():
    RECEIVERS["bus"].refuse_health = ValueError("not JSON")
    async with running(config_of(outlets=outlets("bus", "other"))) as cell:
        status = await look(cell, 2)
        assert status["sinks"]["bus"]["error"] == "ValueError: not JSON"
        assert RECEIVERS["other"].health


@at_once
async def test_an_outlet_that_cannot_be_made_at_a_reload_is_down_until_it_can(monkeypatch):
    make = FakeOutlet.__init__

    def broken(self, name, settings, view):
        if settings.note == "bad":
            raise KeyError("token")
        make(self, name, settings, view)

    monkeypatch.setattr(FakeOutlet, "__init__", broken)
    succeeded = []
    monkeypatch.setattr(FakeOutlet, "succeed", lambda _, before: succeeded.append(before.settings.note))
    DEVICES["arm"].tell(answer)
    async with running(config_of(outlets=outlets("bus", "other"))) as cell:
        await cell.reload(config_of(outlets=outlets("bus", "other", bus="bad")))
        DEVICES["arm"].tell(give(20))
        await DEVICES["arm"].done()
        status = await look(cell, 2)
        bus = status["sinks"]["bus"]
        assert (bus["state"], bus["error"]) == ("down", "KeyError: 'token'")
        assert RECEIVERS["other"].values == list(range(20))
        assert bus["counters"]["items lost"] >= 20
        monkeypatch.setattr(FakeOutlet, "__init__", make)
        await until(lambda: len(RECEIVERS["bus"].runs) == 2)
        DEVICES["arm"].tell(give(20))
        await DEVICES["arm"].done()
        await until(lambda: RECEIVERS["bus"].values == list(range(20, 40)))
        assert succeeded == [""], "it goes on where the one before the reload was"
