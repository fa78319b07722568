"""Plain JSON topics at a real Mosquitto."""

from __future__ import annotations

import json
from dataclasses import replace

from cellwatt import Alarm, Event, Interval, Prediction, Task
from tests.daemon.outlets.mqtt.broker import Broker, Heard, ears, needs_mosquitto
from tests.daemon.outlets.mqtt.cell import LAYOUT, ROOT, STEP, Cell, alarm, online, outlet_of, serving
from tests.patience import eventually

pytestmark = needs_mosquitto
S = 10**9


async def test_rows_units_availability_and_health_have_their_topics(broker: Broker) -> None:
    cell = Cell()
    outlet = outlet_of(cell, broker.url, units={"energy": "kJ"})
    async with ears(broker) as heard:
        async with serving(outlet, cell):
            await heard.until(f"{ROOT}/availability")
            outlet.offer(cell.frames(3))
            await heard.until(f"{ROOT}/frame", 3)
            await heard.until(f"{ROOT}/health")
        await heard.until(f"{ROOT}/availability", 2)
    rows = [json.loads(p) for p in heard.of(f"{ROOT}/frame")]
    assert [row["time"] for row in rows] == [cell.start + i * STEP for i in range(3)]
    assert [row["sequence"] for row in rows] == [0, 1, 2]
    assert [row["values"]["meter.energy"] for row in rows] == [0.0, 0.1, 0.2]
    assert rows[0]["quality"] == {} and "backfilled" not in rows[0]
    units = json.loads(heard.of(f"{ROOT}/units")[0])
    assert units == dict(zip(LAYOUT.names, ("rad", "W", "kJ"), strict=True))
    assert json.loads(heard.of(f"{ROOT}/health")[0])["state"] == "green"
    assert heard.of(f"{ROOT}/availability") == [b"online", b"offline"]


async def test_results_are_those_of_the_bus_and_an_interval_is_told_twice(broker: Broker) -> None:
    running = Interval("arm", 7, S, 2 * S, (1,), (0.1,), (0.0,), (0.5,), closed=False)
    async with online(broker, Cell()) as (outlet, heard):
        for end in (2, 3, 4):
            outlet.offer(replace(running, end=end * S))
        outlet.offer(replace(running, end=5 * S, closed=True))
        outlet.offer(Task("arm", "task_1", "abc", "speed=1.00", 1.0, S, 5 * S, (7,), 3))
        outlet.offer(Event(S, "arm", "connected", "UR10e"))
        await heard.until(f"{ROOT}/event")
    intervals = [json.loads(p) for p in heard.of(f"{ROOT}/interval")]
    assert [(i["end"], i["closed"]) for i in intervals] == [(2 * S, False), (5 * S, True)]
    task = json.loads(heard.of(f"{ROOT}/task")[0])
    assert (task["name"], task["repetition"], task["mark"]["sequence"]) == ("task_1", 3, 0)


async def test_predictions_are_rows_too(broker: Broker) -> None:
    cell = Cell()
    async with online(broker, cell, rate="10 Hz") as (outlet, heard):
        outlet.offer(cell.frames(1))
        begin = cell.start // (5 * STEP) * (5 * STEP)  # where a span ends
        times = tuple(begin + i * STEP for i in range(1, 11))
        outlet.offer(Prediction("power", 1, times, {"power": tuple(float(i) for i in range(1, 11))}, {"power": "W"}))
        told = [json.loads(p) for p in await heard.until(f"{ROOT}/prediction/power", 2)]
    assert [(t["time"], t["values"]["power"]) for t in told] == [
        (begin + 5 * STEP, 3.0),
        (begin + 10 * STEP, 8.0),
    ]
    assert told[0]["units"] == {"power": "W"}


async def _kept(broker: Broker, topic: str) -> list[Heard]:
    """What the broker keeps, told by what comes before its answer to something else."""
    async with ears(broker, topic) as heard:
        async with ears(broker, "nothing") as other:
            await other.say(f"{topic.removesuffix('#')}end", b"end")
        await heard.until(f"{topic.removesuffix('#')}end")
        return [m for m in heard.heard if m.payload != b"end"]


async def test_an_alarm_is_kept_until_it_is_cleared(broker: Broker) -> None:
    topic = f"{ROOT}/alarm/error/joint_fault/faults.arm.1"
    async with online(broker, Cell()) as (outlet, heard):
        for number in (1, 2):
            outlet.offer(alarm(number))
        outlet.offer(alarm(2, severity="warning"))
        outlet.offer(alarm(1, active=False))
        await heard.until(topic, 3)
        (kept,) = await _kept(broker, f"{ROOT}/alarm/#")
    assert kept.topic == f"{ROOT}/alarm/warning/joint_fault/faults.arm.2"
    told = [m for m in heard.heard if m.topic == topic]
    assert [(bool(m.payload), m.retain) for m in told] == [(True, True), (True, False), (False, True)]
    assert json.loads(told[1].payload)["active"] is False


async def test_alarms_of_a_daemon_before_go_and_those_that_are_up_come(broker: Broker) -> None:
    cell = Cell()
    cell.alarms.take(Alarm("a/b", "source_down", "warning", True, 1, 2, "It is down."))
    async with ears(broker, "nothing") as other:
        await other.say(f"{ROOT}/alarm/error/joint_fault/old", b"{}", retain=True)
        await other.say("cellwatt/plant-1/other/alarm/error/joint_fault/x", b"{}", retain=True)
    async with ears(broker, f"{ROOT}/alarm/#") as heard, serving(outlet_of(cell, broker.url), cell):
        await heard.until(f"{ROOT}/alarm/error/joint_fault/old", 2)
        await heard.until(f"{ROOT}/alarm/warning/source_down/+")
        kept = await _kept(broker, "cellwatt/plant-1/#")
    kept = [m for m in kept if "/alarm/" in m.topic]
    assert sorted(m.topic for m in kept) == [
        "cellwatt/plant-1/other/alarm/error/joint_fault/x",
        f"{ROOT}/alarm/warning/source_down/a%2Fb",
    ]


async def test_the_last_row_is_kept_as_long_as_it_is_wanted(broker: Broker) -> None:
    cell = Cell()
    async with online(broker, cell, retain=True) as (outlet, heard):
        outlet.offer(cell.frames(2))
        await heard.until(f"{ROOT}/frame", 2)
        (kept,) = await _kept(broker, f"{ROOT}/frame/#")
    assert json.loads(kept.payload)["sequence"] == 1
    async with online(broker, cell, retain=True), ears(broker, f"{ROOT}/frame") as heard:
        await heard.until(f"{ROOT}/frame")
        assert heard.of(f"{ROOT}/frame") == [kept.payload]
    async with online(broker, cell) as (outlet, heard):
        await eventually(lambda: b"" in heard.of(f"{ROOT}/frame"), "its deletion")
        assert await _kept(broker, f"{ROOT}/frame/#") == []


async def test_queues_are_bounded_and_what_they_drop_is_counted(broker: Broker) -> None:
    cell = Cell()
    outlet = outlet_of(cell, broker.url, queue=5)
    outlet.offer(cell.frames(8))
    for number in range(7):
        outlet.offer(alarm(number))
    async with ears(broker, f"{ROOT}/#") as heard, serving(outlet, cell):
        rows = [json.loads(p) for p in await heard.until(f"{ROOT}/backfill/frame", 5)]
        await eventually(lambda: outlet.account.counters["results sent"] == 5, "results")
    assert [row["sequence"] for row in rows] == [3, 4, 5, 6, 7]
    assert all(row["backfilled"] is True for row in rows)
    assert outlet.account.counters["rows dropped"] == 3 and outlet.account.counters["results dropped"] == 2
