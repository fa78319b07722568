"""The demo's clients read what real servers say, and programs come and go with the demo."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt
import numpy as np
import pytest

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.demo.cells import free_endpoint
from cellwatt.demo.outlets import programs, readers
from cellwatt.demo.outlets.said import CURRENT, POWER, Said
from cellwatt.errors import CellwattError
from cellwatt.outlets.opc_ua.outlet import OpcUaOutlet
from cellwatt.outlets.opc_ua.settings import OpcUaOutletSettings
from tests.daemon.outlets.metrics import cell
from tests.daemon.outlets.metrics.cell import health, outlet_of, source
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm
from tests.patience import eventually

MOSQUITTO, PROMETHEUS = programs.find("mosquitto"), programs.find("prometheus")
broker = pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed (apt-get install mosquitto)")
scrapes = pytest.mark.skipif(PROMETHEUS is None, reason="prometheus is not installed (apt-get install prometheus)")
LAYOUT = Layout(
    (FrameChannel(POWER, "W", "continuous", "average"), FrameChannel(CURRENT, "A", "continuous", "linear")), 50.0
)
ROOT = "cellwatt/demo/demo"


def frames(number: int, power: float, current: float) -> Frames:
    still = np.zeros((1, 2), np.int64)
    time = EPOCH + np.array([number]) * LAYOUT.step
    return Frames(LAYOUT, number, time, np.array([[power, current]]), still.astype(np.uint8), still)


@asynccontextmanager
async def reading(work: Any) -> AsyncIterator[None]:
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait([task])
        assert task.cancelled()


@scrapes
@pytest.mark.slow
async def test_prometheus_is_read(tmp_path: Path) -> None:
    assert PROMETHEUS is not None
    outlet, said, at = outlet_of(), Said("Prometheus"), await asyncio.to_thread(free_endpoint)
    up = [cell.alarm("error", "joint_fault"), cell.alarm("info", "meter_timing")]
    outlet.health(health(state="amber", sources={"arm": source(7001)}, alarms=up))
    outlet.offer(frames(1, 231.0625, 1.0))
    async with (
        reading(readers.read_prometheus(said, at)),
        cell.serving(outlet) as url,
    ):
        await eventually(lambda: said.problem.startswith("does not answer"), "nobody is there yet")
        async with programs.prometheus(PROMETHEUS, tmp_path, at, url.removeprefix("http://")):
            await eventually(lambda: said.complete, "a scrape")
            assert not said.problem
            assert [told.key for told in said.frames] == [231.0625]
            assert said.states[-1].values == {"state": "amber", "samples of arm": 7001, "alarms that are up": 2}
            await eventually(lambda: "CellwattAlarm is pending" in said.fault, "our rule")
            outlet.health(health(sources={"arm": source(7501)}))
            await eventually(lambda: not said.fault, "the alarm is over")


def test_a_scrape_that_got_nothing_changes_nothing() -> None:
    said = Said("Prometheus")
    said.alarm("up")
    readers.take_series(said, [{"metric": {"__name__": "cellwatt_power_watts", "channel": POWER}, "value": [1, "5"]}])
    assert said.problem == "has no values of the cell from its last scrape"
    assert (said.fault, said.complete) == ("up", False)


@broker
async def test_a_broker_is_read_and_found_again(tmp_path: Path) -> None:
    assert MOSQUITTO is not None
    said, at = Said("MQTT"), await asyncio.to_thread(free_endpoint)
    topic = f"{ROOT}/alarm/error/joint_fault/a1"
    async with reading(readers.read_mqtt(said, at)):
        async with programs.mosquitto(MOSQUITTO, tmp_path, at), aiomqtt.Client("127.0.0.1", port_of(at)) as cell:
            await eventually(lambda: said.problem == "has not told a frame yet", "it is connected")
            values = {POWER: 231.0625, CURRENT: -0.5, "arm.joint_1.current": 1.0}
            await cell.publish(f"{ROOT}/frame", json.dumps({"time": EPOCH, "sequence": 1, "values": values}))
            status = {"state": "green", "sources": {"arm": {"received": 500}}, "alarms": []}
            await cell.publish(f"{ROOT}/health", json.dumps(status), retain=True)
            await cell.publish(topic, json.dumps({"active": True}), retain=True)
            await eventually(lambda: said.complete and said.fault, "all of them")
            assert said.frames[-1].values == {POWER: 231.0625, CURRENT: -0.5}
            assert said.frames[-1].time == EPOCH
            assert said.fault == "kept by the broker on …/alarm/error/joint_fault/a1"
            await cell.publish(topic, b"", retain=True)
            await eventually(lambda: not said.fault, "the alarm is over")
        await eventually(lambda: "does not answer" in said.problem, "the broker has ended")
        async with programs.mosquitto(MOSQUITTO, tmp_path, at):
            await eventually(lambda: said.problem == "has not told a frame yet", "it is there again")


def port_of(address: str) -> int:
    return int(address.rpartition(":")[2])


@pytest.mark.slow
async def test_an_opc_ua_server_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "_SPACE", f"urn:cellwatt:{SITE}:{CELL}")
    at = await asyncio.to_thread(free_endpoint)
    said = Said("OPC UA")
    outlet = OpcUaOutlet("opc_ua", OpcUaOutletSettings.model_validate({"listen": at, "rate": "50 Hz"}), FakeView())
    async with reading(readers.read_opc_ua(said, f"opc.tcp://{at}/cellwatt")), reading(outlet.run()):
        await eventually(lambda: "does not answer" in said.problem, "it starts for seconds")
        await eventually(lambda: outlet.url is not None, "the server")
        for number in range(1, 5):
            outlet.offer(frames(number, 100.0625 + number, -0.5))
        outlet.health({"state": "green", "sources": {"arm": {"received": 500}}, "alarms": []})
        await eventually(lambda: said.states, "a client that knows the channels")
        outlet.offer(frames(5, 231.0625, 0.25))
        outlet.offer(alarm(1))
        await eventually(lambda: said.complete and said.frames[-1].key == 231.0625 and said.fault, "all of them")
        assert said.frames[-1].values == {POWER: 231.0625, CURRENT: 0.25}
        assert said.frames[-1].time == EPOCH + 5 * LAYOUT.step
        assert said.fault == "condition joint_fault, severity 800: Joint 1 needs more power than it should."
        outlet.offer(alarm(1, active=False))
        await eventually(lambda: not said.fault, "the alarm is over")


async def test_a_program_that_does_not_come_up_is_told(tmp_path: Path) -> None:
    at = await asyncio.to_thread(free_endpoint)
    with pytest.raises(CellwattError, match=r"^mosquitto ended with exit code 1: SyntaxError: "):
        async with programs.mosquitto(sys.executable, tmp_path, at):  # takes the name of the file for a program
            pass
    with pytest.raises(CellwattError, match=r"^/nowhere cannot be started: No such file or directory$"):
        async with programs.mosquitto("/nowhere", tmp_path, at):
            pass
