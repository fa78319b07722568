"""A cell that starts with some of its parts away, and one that cannot start."""

from __future__ import annotations

import asyncio
from unittest.mock import Mock

import pytest

from cellwatt import Alarm, ConnectError, Event, OutletError
from cellwatt.record import Recording
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    JUDGES,
    RECEIVERS,
    FakeOutlet,
    alarm,
    answer,
    config_of,
    fail,
    give,
    hang,
    look,
    running,
    sources,
    stages,
    until,
)

NOBODY = ConnectError("no device answers at 192.0.2.1:30004")


@at_once
async def test_each_source_is_on_its_own():
    DEVICES["arm"].tell(answer, give(5))
    DEVICES["board"].tell(*[fail(NOBODY)] * 1000)
    DEVICES["meter"].tell(hang)
    async with running(config_of(sources=sources("arm", "board", "meter"))) as cell:
        await DEVICES["arm"].done()
        states = {name: s["state"] for name, s in (await look(cell))["sources"].items()}
        assert states == {"arm": "ok", "board": "retrying", "meter": "starting"}
        assert cell.view.status()["state"] == "amber"
        assert RECEIVERS["bus"].values == [0, 1, 2, 3, 4]


@at_once
async def test_a_cell_that_hears_nobody_is_red_and_says_who_is_away():
    DEVICES["arm"].tell(*[fail(NOBODY)] * 1000)
    async with running(config_of()) as cell:
        await until(lambda: DEVICES["arm"].runs)
        status = await look(cell, 4)
        assert status["state"] == "red"
        (found,) = RECEIVERS["bus"].of(Alarm)
        assert found.statement == f"Source arm is down: {NOBODY}"
        assert [a["id"] for a in status["alarms"]] == ["source_down:arm"]


async def test_an_alarm_of_a_stage_reaches_outlets_record_and_health(tmp_path):
    raised, cleared = alarm("heat", stage="judge"), alarm("heat", active=False, stage="judge")
    told = {2: raised, 4: raised, 6: cleared}
    JUDGES["judge"].give = lambda frames, _: [  # in whatever blocks they come
        told[number] for number in range(frames.sequence, frames.sequence + len(frames)) if number in told
    ]
    async with running(config_of(stages=stages("judge"), record=tmp_path)) as cell:
        DEVICES["arm"].tell(answer, give(4))
        await until(lambda: RECEIVERS["bus"].of(Alarm))
        assert len(heat((await look(cell))["alarms"])) == 1
        DEVICES["arm"].tell(give(5))
        await until(lambda: len(heat(RECEIVERS["bus"].of(Alarm))) == 3)
        assert heat((await look(cell))["alarms"]) == []
        assert cell.view.status()["results"] >= 3
    assert heat(Recording.open(tmp_path).results()) == [raised, raised, cleared]


def heat(alarms):
    """Those of the stage: on a busy machine others tell that frames come late."""
    return [a for a in alarms if (a["id"] if isinstance(a, dict) else a.id) == "heat"]


async def test_what_is_recorded_is_what_was_given(tmp_path):
    async with running(config_of(record=tmp_path)) as cell:
        DEVICES["arm"].tell(answer, give(25), fail(NOBODY), answer, give(5))
        await DEVICES["arm"].done()
        found = await asyncio.to_thread(cell.view.history, "arm", "supply", cell.session, 5, 10)
        assert [int(v) for b in found for v in b.values[:, 0]] == list(range(5, 15))
    recording = Recording.open(tmp_path)
    values = [int(v) for b in recording.entries() if hasattr(b, "values") for v in b.values[:, 0]]
    assert values == RECEIVERS["bus"].values == list(range(30))
    assert [n for f in recording.frames() for n in range(f.sequence, f.sequence + len(f))] == RECEIVERS["bus"].frames
    assert [e.kind for e in recording.events()] == ["connected", "lost", "reconnected"]


async def test_a_cell_may_ask_what_it_is():
    async with running(config_of()) as cell:
        schema = cell.view.schema()
        assert [s["name"] for s in schema["streams"]["arm"]] == ["supply"]
        assert [c["name"] for c in schema["frame"]["channels"]] == ["arm.bus.voltage", "arm.bus.current"]
        assert cell.view.config()["sources"]["arm"]["host"] == "arm"
        assert (cell.view.recordings(), cell.view.history("arm", "supply", cell.session, 0, 10)) == ((), ())


# what cannot start ------------------------------------------------------------------------------------


async def start(config):
    async with running(config):
        pytest.fail("started")


async def test_an_outlet_that_cannot_be_made_is_told(monkeypatch):
    monkeypatch.setattr(FakeOutlet, "__init__", Mock(side_effect=OutletError("no certificate at plant.pem")))
    with pytest.raises(OutletError, match=r"no certificate at plant\.pem"):
        await start(config_of())


async def test_a_mistake_of_ours_stays_a_traceback(monkeypatch):
    monkeypatch.setattr(FakeOutlet, "__init__", Mock(side_effect=AttributeError("colour")))
    with pytest.raises(ExceptionGroup) as caught:
        await start(config_of())
    assert caught.group_contains(AttributeError, match="colour")


async def test_a_clock_set_while_it_runs_is_told(monkeypatch):
    async with running(config_of()) as cell:
        monkeypatch.setattr(cell.clock, "discipline", lambda: 2_500_000_000)
        await until(lambda: RECEIVERS["bus"].of(Event))
        (found, *_) = RECEIVERS["bus"].of(Event)
        assert (found.kind, found.data) == ("wall_clock_step", {"step_s": 2.5})
        assert "set by +2.500 s" in found.text
