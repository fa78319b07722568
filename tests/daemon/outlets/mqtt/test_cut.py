"""What a cut does over MQTT beyond what holds for all outlets: topics of the past, results, births."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import pytest

from cellwatt import Task
from tests.daemon.outlets.mqtt.broker import Broker, Ears, ears, needs_mosquitto, started
from tests.daemon.outlets.mqtt.cell import ROOT, STEP, Cell, alarm, online, outlet_of, serving
from tests.daemon.outlets.mqtt.wire import command
from tests.patience import eventually

pytestmark = needs_mosquitto
BIRTH = "spBv1.0/plant-1/NBIRTH/weld-3"
LIVE, PAST = f"{ROOT}/frame", f"{ROOT}/backfill/frame"


def numbers(heard: Ears, cell: Cell, topic: str) -> list[int]:
    """Numbers of the frames in the rows that were heard, which their values say as well."""
    rows = [json.loads(payload) for payload in heard.of(topic)]
    for row in rows:
        assert row["values"]["arm.joint_1.position"] == cell.number(row["time"])
    return [cell.number(row["time"]) for row in rows]


async def test_results_of_before_a_restart_are_sent_from_the_record(broker: Broker, tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    async with ears(broker, f"{ROOT}/#") as heard:
        async with serving(outlet_of(cell, broker.url), cell):
            await heard.until(f"{ROOT}/availability", 1)
            outlet_rows = cell.frames(10)
        at = cell.start + 12 * STEP  # told to nobody: the daemon went down before
        assert cell.record is not None
        task = Task("arm", "task_1", "ab", "v", 1.0, at - STEP, at, (1,), 4)
        cell.record.chunk(replace(alarm(7), time=at, since=at), task)
        cell.frames(10)
        outlet = outlet_of(cell, broker.url, backfill="1 kHz")
        outlet._cursor.position.reached, outlet._cursor._opened = int(outlet_rows.time[-1]), True
        async with serving(outlet, cell):
            await heard.until(f"{ROOT}/availability", 3)
            outlet.offer(cell.frames(150))
            await heard.until(f"{ROOT}/backfill/task", 1)
            await heard.until(PAST, 10)
            await eventually(lambda: outlet._cursor.first is None, "all is filled")
    (told,) = (m for m in heard.heard if m.topic.startswith(f"{ROOT}/backfill/alarm"))
    assert json.loads(told.payload)["id"] == "faults.arm.7" and not told.retain
    assert not [m for m in heard.heard if m.topic.startswith(f"{ROOT}/alarm/")], "it is not up now"
    assert json.loads(heard.of(f"{ROOT}/backfill/task")[0])["repetition"] == 4
    assert outlet.account.counters["results back-filled"] == 2 and outlet.account.residue == 0
    cell.close()


async def test_live_rows_go_before_those_of_the_past(broker: Broker, tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    outlet = outlet_of(cell, broker.url, backfill="50 Hz")
    outlet._cursor.position.reached, outlet._cursor._opened = cell.start - STEP, True
    outlet.offer(cell.frames(200))
    async with ears(broker, f"{ROOT}/#") as heard, serving(outlet, cell):
        await heard.until(PAST, 3)
        outlet.offer(cell.frames(150))
        await heard.until(LIVE, 150)
        assert len(heard.of(PAST)) < 100, "the past is held back to 50 rows a second"
        assert numbers(heard, cell, LIVE) == list(range(200, 350))
    cell.close()


async def test_rows_that_a_full_queue_gives_up_are_sent_from_the_record(broker: Broker, tmp_path: Path) -> None:
    """The broker confirms more slowly than rows are made."""
    cell = Cell(tmp_path)
    async with online(broker, cell, queue=5, backfill="1 kHz") as (outlet, heard):
        await eventually(lambda: outlet._outbox.serving, "connected")
        outlet.offer(cell.frames(8))  # at once, before the first can be sent
        await heard.until(LIVE, 4)
        outlet.offer(cell.frames(150))
        await eventually(lambda: len(heard.of(LIVE)) + len(heard.of(PAST)) >= 158, "all is heard")
        await eventually(lambda: outlet.account.owed == 0, "all is confirmed")
        assert sorted(numbers(heard, cell, LIVE) + numbers(heard, cell, PAST)) == list(range(158))
    assert outlet.account.counters["rows left to the record"] == 4 + 146, "two at a time"
    assert not outlet.account.dropped and outlet.account.residue == 0
    cell.close()


async def test_results_and_rows_on_their_way_come_again_where_there_is_no_record(broker: Broker) -> None:
    """What a broker took and forgot before it confirmed it: here, what it was given while it hung."""
    cell = Cell()
    outlet = outlet_of(cell, broker.url)
    async with serving(outlet, cell) as ends:
        await eventually(lambda: outlet._session is not None and outlet._outbox.serving, "connected")
        await eventually(lambda: outlet._session is None or not outlet._session._asked, "the birth is confirmed")
        broker.hang()
        for number in range(5):
            outlet.offer(alarm(number, active=False))
        outlet.offer(cell.frames(20))
        await eventually(lambda: not outlet._outbox.rows and not outlet._outbox.results, "all is on its way")
        cell.may_connect.clear()
        broker.kill()
        await eventually(lambda: ends, "the cut is noticed")
        await broker.again()
        async with ears(broker, f"{ROOT}/#") as heard:
            cell.may_connect.set()
            await heard.until(PAST, 20)
            told = [p for p in heard.of(f"{ROOT}/alarm/#") if p]
    assert numbers(heard, cell, PAST) == list(range(20)) and heard.of(LIVE) == []
    assert [json.loads(p)["id"] for p in told] == [f"faults.arm.{n}" for n in range(5)]
    assert outlet.account.counters["rows dropped"] == outlet.account.counters["results dropped"] == 0


async def test_a_broker_that_does_not_take_what_we_publish_is_told_of(tmp_path: Path) -> None:
    rules = tmp_path / "rules"
    rules.write_text(f"topic readwrite {ROOT}/availability\ntopic read #\n")
    cell = Cell()
    # Without a limit, this broker ends the connection after a refusal.
    settings = f"acl_file {rules}", "max_queued_messages 1000"
    async with started(tmp_path, *settings) as broker, serving(outlet := outlet_of(cell, broker.url), cell):
        await eventually(lambda: outlet._outbox.serving, "connected")
        assert outlet.trouble() is None
        outlet.offer(cell.frames(1))
        await eventually(lambda: outlet.account.counters["messages refused"] >= 1, "a refusal")
        assert "refuses messages (not authorized)" in (outlet.trouble() or "")
        await eventually(lambda: outlet.account.counters["rows refused"] == 1, "the row is told apart")
        assert outlet.account.missed["refused"] == 1 and outlet.account.received == outlet.account.residue == 0


async def test_a_message_that_is_too_large_for_the_broker_holds_nothing_up(tmp_path: Path) -> None:
    cell = Cell()
    settings = "max_packet_size 800", "max_queued_messages 1000"
    async with started(tmp_path, *settings) as broker, serving(outlet := outlet_of(cell, broker.url), cell) as ends:
        await eventually(lambda: outlet._outbox.serving, "connected")
        outlet.offer(alarm(1, statement="x" * 1000))
        outlet.offer(cell.frames(3))
        await eventually(lambda: outlet.account.counters["rows sent"] == 3, "the rows")
        assert outlet.account.counters["results refused"] == 1 and ends == []
        assert "packet too large" in str(outlet.trouble())


async def test_health_says_what_is_waited_for(broker: Broker) -> None:
    cell = Cell()
    outlet = outlet_of(cell, broker.url, format="sparkplug", sparkplug={"primary_host": "scada"}, channels=["door.*"])
    outlet.offer(cell.frames(1))
    assert outlet.trouble() == "channels: no channel of the frames matches door.*"
    async with serving(outlet, cell):
        await eventually(lambda: "scada is not online" in (outlet.trouble() or ""), "the host is missing")


async def test_births_that_are_asked_for_in_a_row_are_merged(broker: Broker) -> None:
    cell = Cell()
    outlet = outlet_of(cell, broker.url, format="sparkplug")
    async with ears(broker, BIRTH) as host, serving(outlet, cell):
        await host.until(BIRTH)
        for _ in range(100):
            await host.say("spBv1.0/plant-1/NCMD/weld-3", command("Node Control/Rebirth", True))
        await eventually(lambda: outlet.account.counters["rebirths merged"] >= 90, "what was asked for")
        await host.until(BIRTH, 2)
        assert len(host.of(BIRTH)) + outlet.account.counters["rebirths merged"] <= 101


async def test_a_outlet_with_new_settings_goes_on_where_the_one_before_ended(broker: Broker, tmp_path: Path) -> None:
    cell = Cell()
    before = outlet_of(cell, broker.url)
    before.offer(alarm(1, active=False))
    before.offer(cell.frames(2))
    after = outlet_of(cell, broker.url, qos=2)
    after.succeed(before)
    async with ears(broker, f"{ROOT}/#") as heard, serving(after, cell):
        await heard.until(f"{ROOT}/backfill/frame", 2)
        await heard.until(f"{ROOT}/alarm/#")


async def test_stopping_while_the_broker_does_not_answer_is_quick_and_leaves_nothing(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cellwatt.outlets.mqtt.session.LAST_WORDS", 0.3)
    cell = Cell()
    async with serving(outlet := outlet_of(cell, broker.url), cell):
        await eventually(lambda: outlet._outbox.serving, "connected")
        broker.hang()
        outlet.offer(cell.frames(3))
    async with serving(outlet_of(cell, broker.url), cell):  # it answers no connection either
        await asyncio.sleep(0.05)


async def test_the_broker_tells_of_a_connection_that_broke(broker: Broker) -> None:
    cell = Cell()
    async with online(broker, cell) as (outlet, heard):
        cell.may_connect.clear()
        assert outlet._session is not None
        await outlet._session._link.abort()
        await heard.until(f"{ROOT}/availability", 2)
    told = [(m.payload, m.retain) for m in heard.heard if m.topic.endswith("/availability")]
    assert told == [(b"online", True), (b"offline", True)]
