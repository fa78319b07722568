"""``cellwatt demo --outlets``: the demo's cell in Prometheus, MQTT and OPC UA at once, with the real programs."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import psutil
import pytest

from cellwatt.demo.outlets.programs import find
from tests.patience import PATIENCE, eventually
from tests.system.test_ends_with_parent import descendants, end_of_all, line_with, running

MOSQUITTO, PROMETHEUS = find("mosquitto"), find("prometheus")
needs_all = pytest.mark.skipif(not (MOSQUITTO and PROMETHEUS), reason="apt-get install mosquitto prometheus")
pytestmark = [pytest.mark.system, pytest.mark.slow]


@needs_all
@pytest.mark.timeout(300)
async def test_all_three_say_the_same_and_show_the_alarm() -> None:
    async with running("demo", "--outlets", "--seconds", "20", "--json") as demo:
        told, said = await demo.communicate()
    summary = json.loads(told)
    found = summary["outlets"]
    assert demo.returncode == (0 if summary["ok"] else 1), said.decode()
    assert set(found["told"]) == {"Prometheus", "MQTT", "OPC UA"}
    assert found["left_out"] == found["unlike"] == {}
    # Prometheus scrapes each second; on a busy machine some of its frames are not looked for in time.
    assert found["alike"]["frames"] > 5 and found["alike"]["health"] > 5, found
    assert "alert CellwattAlarm" in found["told"]["Prometheus"]["alarm"]
    assert "/alarm/error/joint_fault/" in found["told"]["MQTT"]["alarm"]
    assert "Joint 3 " in found["told"]["OPC UA"]["alarm"]
    # The alarm takes as long as it takes the demo's own subscriber, and Prometheus a scrape more.
    assert all(outlet["alarm_after_s"] > 0 for outlet in found["told"].values()), found
    assert not [problem for problem in summary["problems"] if "outlets" in problem or "alarm was not" in problem]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=lambda n: n.name)
@pytest.mark.timeout(240)
async def test_no_program_is_left_behind(number: signal.Signals, tmp_path: Path) -> None:
    async with running("demo", "--outlets", "--seconds", "600", "--json", "--keep", str(tmp_path)) as demo:
        await line_with("waiting for the outlets", demo.stderr)
        await line_with("the spring comes halfway", demo.stderr)
        others = descendants(demo.pid)
        names = {psutil.Process(pid).name() for pid in others}
        assert {Path(program).name for program in (MOSQUITTO, PROMETHEUS) if program} <= names
        demo.send_signal(number)
        told, _ = await asyncio.wait_for(demo.communicate(), PATIENCE)
    assert await asyncio.to_thread(end_of_all, others) == []
    if number is signal.SIGINT:
        assert json.loads(told)["problems"][0] == "the demo was ended early: SIGINT"


@pytest.mark.timeout(240)
async def test_a_demo_that_is_ended_while_it_starts_leaves_nothing(tmp_path: Path) -> None:
    async with running("demo", "--outlets", "--seconds", "600", "--json", "--keep", str(tmp_path)) as demo:
        await eventually((tmp_path / "daemon.log").exists, "the daemon is started")
        others = descendants(demo.pid)
        demo.terminate()
        _, said = await asyncio.wait_for(demo.communicate(), PATIENCE)
    assert await asyncio.to_thread(end_of_all, others) == []
    assert demo.returncode == 3
    assert said.decode().splitlines()[-1] == "cellwatt: the demo was ended before everything ran: SIGTERM"
