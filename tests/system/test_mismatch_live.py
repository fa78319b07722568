"""The whole way of a mismatch: an arm that becomes stiff, told by a daemon that names joint, effect and time."""

from __future__ import annotations

import asyncio
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from tests.plugins.mismatch.emulated_arm import recorded, write_rtde
from tests.plugins.mismatch.recorded_arm import write_robot
from tests.system.running import Audience, Daemon, balanced, running

# The stage and its explanation are in every run: tests/plugins/mismatch/live/test_explanation.py.
pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(420)]

FRICTION = 30.0
"""Nm s/rad that joint 2 has from then on …"""
SINCE = 3.0
"""… s of the recording that the emulator serves."""


def of(kind: str, audience: Audience) -> list:
    return [alarm for alarm in audience.alarms if alarm.kind == kind]


async def test_a_stiff_joint_is_located_and_the_friction_named(tmp_path: Path) -> None:
    robot = tmp_path / "bench"
    robot.mkdir()
    write_robot(robot, viscous_friction=0.0)
    table = tmp_path / "arm.parquet"
    await asyncio.to_thread(lambda: write_rtde(table, recorded(150, 125, viscous=FRICTION, since=SINCE)))
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0", "--recording", str(table)) as device:
        host, port = device.address.split(":")
        channels = "[actual_q, actual_qd, actual_current, target_q, target_qd, target_qdd]"
        text = f"""
robot: bench
sources:
  arm: {{driver: ur, host: {host}, port: {port}, rate: 125 Hz, channels: {channels}}}
stages:
  segment: {{}}
  mismatch: {{explain: {{after: 4, folder: {tmp_path / "mismatch"}}}}}
"""
        async with running(tmp_path, text) as (daemon, audience):
            await told(daemon, audience, tmp_path)


async def told(daemon: Daemon, audience: Audience, tmp_path: Path) -> None:
    await audience.until(lambda a: of("simulation_differs", a), 60)
    differs = of("simulation_differs", audience)[0]
    assert differs.joint == 2
    await audience.until(lambda a: of("mismatch", a) or of("explanation_failed", a), 270)
    assert not of("explanation_failed", audience)
    alarm = of("mismatch", audience)[0]
    findings = alarm.evidence["findings"]
    assert (findings[0]["effect"], findings[0]["joint"]) == ("viscous_friction", 2), alarm.statement
    assert findings[0]["parameters"]["coefficient"]["value"] == pytest.approx(FRICTION, rel=0.1)
    assert_report(alarm.evidence["report"], tmp_path / "mismatch")
    assert {a.joint for a in of("simulation_differs", audience)} == {2}
    await audience.until(lambda a: a.status["stages"]["mismatch"]["frames"] > 0)
    assert audience.status["stages"]["mismatch"]["dropped"] == 0
    assert audience.status["stages"]["mismatch"]["failures"] == 0
    assert balanced(audience.source("arm"))
    torque = [x for p in audience.results["prediction"] for x in p.outputs["arm.joint_2.torque"]]
    assert np.isfinite(torque).mean() > 0.95
    assert await daemon.stop() == 0


def assert_report(link: str, folder: Path) -> None:
    report = Path(url2pathname(urlparse(link).path))
    assert report.is_relative_to(folder)
    assert b"<html" in report.read_bytes()
