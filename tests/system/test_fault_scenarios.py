"""The three scenarios of Sabry et al. on an emulated IRB 1200 and its serial power board, live through the daemon.

Each runs at both speeds of Fig. 19.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.registry import available
from cellwatt.results import Alarm
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.paper.course import Course, courses_of
from cellwatt_plugins.faults.paper.expected import Readings
from cellwatt_plugins.faults.paper.judging import codes_of
from cellwatt_plugins.faults.paper.network import train
from cellwatt_plugins.faults.paper.trained_for import TrainedFor
from cellwatt_plugins.faults.reference import load
from tests.plugins.faults.paper.irb1200 import PICK_AND_PLACE, POLISHING, Fault, Move, Run, period, run
from tests.plugins.faults.plant import START, frames
from tests.plugins.faults.watching import learned
from tests.system.running import Audience, Daemon, free_port

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(
        "faults_by_paper" not in available("cellwatt.stages"),
        reason="the stage faults_by_paper is not registered: install the package again",
    ),
]

SPRING = (Fault("spring", 3, 60.0),)
TWO_JOINTS = (Fault("cut", 2), Fault("belt_off", 5))
TWO_JOINTS_AND_ENCODER = (*TWO_JOINTS, Fault("encoder_creep", 2, 0.1))
STIFFNESS = (60.0, 60.0, 60.0, 40.0, 30.0, 40.0)
"""Nm/rad of the springs by which the plant's fault table is learnt, joint by joint."""
READY = 4.0
"""s at rest before the first cycle. The emulators begin anew at the end, so that a daemon may also come late."""


@dataclass(frozen=True)
class Scenario:
    """``faults`` from cycle ``since`` of ``moves`` at ``speed``; ``expected`` kinds by joint."""

    moves: Sequence[Move]
    faults: Sequence[Fault]
    speed: float
    since: int
    expected: dict[int, str]


JOINTS_2_AND_5 = {2: "joint_fault", 5: "joint_fault"}
WITH_ENCODER_2 = {2: "joint_and_encoder_fault", 5: "joint_fault"}
SCENARIOS = {
    "spring_full_speed": Scenario(PICK_AND_PLACE, SPRING, 1.0, 1, {3: "joint_fault"}),
    "spring_half_speed": Scenario(PICK_AND_PLACE, SPRING, 0.5, 1, {3: "joint_fault"}),
    "two_joints_full_speed": Scenario(POLISHING, TWO_JOINTS, 1.0, 1, JOINTS_2_AND_5),
    "two_joints_half_speed": Scenario(POLISHING, TWO_JOINTS, 0.5, 1, JOINTS_2_AND_5),
    "and_encoder_full_speed": Scenario(POLISHING, TWO_JOINTS_AND_ENCODER, 1.0, 1, WITH_ENCODER_2),
    "and_encoder_half_speed": Scenario(POLISHING, TWO_JOINTS_AND_ENCODER, 0.5, 1, WITH_ENCODER_2),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
async def test_scenario(name: str, tmp_path: Path) -> None:
    scenario = SCENARIOS[name]
    alarms = await alarms_of(scenario, tmp_path)
    assert {alarm.joint: alarm.kind for alarm in alarms} == scenario.expected
    begun = READY + scenario.since * period(scenario.moves, scenario.speed)
    assert all(alarm.evidence["speed"] == pytest.approx(scenario.speed, abs=0.02) for alarm in alarms)
    epoch, length = map(float, (tmp_path / "epoch").read_text().split())
    for alarm in alarms:
        assert (alarm.since * 1e-9 - epoch) % length > begun - 0.2  # nothing was said of the healthy cycle


async def alarms_of(scenario: Scenario, folder: Path) -> list[Alarm]:
    """The first alarms about joints, as many as are expected, that a subscriber of the daemon got."""
    await asyncio.to_thread(prepare, scenario, folder)
    cycles = scenario.since + 2
    plan = Run(scenario.moves, cycles, scenario.speed, scenario.faults, scenario.since, lead=READY, seed=4)
    told = await asyncio.to_thread(run, plan)
    columns = {"t": told.t} | {f"joint_{j}.position": told.q[:, j - 1] for j in range(1, 7)}
    table = folder / "cell.parquet"
    await asyncio.to_thread(pq.write_table, pa.table(columns | {"supply.power": told.power}), table)
    epoch, egm = time.time(), free_port()
    (folder / "epoch").write_text(f"{epoch} {told.t[-1]}")
    common = ("--recording", str(table), "--loop", "--epoch", str(epoch))
    async with (
        EmulatorProcess("abb", "--listen", "127.0.0.1:0", "--option", f"egm=127.0.0.1:{egm}", *common),
        EmulatorProcess("power_board", *common) as board,
    ):
        network = "network: table.onnx" if (folder / "table.onnx").exists() else ""
        text = f"""
sources:
  arm: {{driver: abb, host: 127.0.0.1, egm_port: {egm}, bind: 127.0.0.1, egm: [joints], web: []}}
  board: {{driver: power_board, port: {board.address}, rate: 123 Hz}}
stages:
  segment: {{}}
  faults: {{stage: faults_by_paper, reference: reference.yaml, power: board.supply.power, {network}}}
"""
        async with Daemon(folder, text) as daemon, Audience(daemon, ("alarm", "health")) as audience:
            return await told_faults(scenario, audience)


async def told_faults(scenario: Scenario, audience: Audience) -> list[Alarm]:
    def found(audience: Audience) -> list[Alarm]:
        first: dict[str, Alarm] = {}
        for alarm in audience.alarms:
            if alarm.kind.endswith("_fault") and alarm.active:
                first.setdefault(alarm.id, alarm)
        return list(first.values())

    seconds = 2 * (READY + (scenario.since + 2) * period(scenario.moves, scenario.speed)) + 10
    await audience.until(lambda a: len(found(a)) >= len(scenario.expected), seconds)
    return found(audience)


def prepare(scenario: Scenario, folder: Path) -> None:
    """The reference of healthy cycles at both speeds; for the spring, the network of the plant's own fault table."""
    blocks = []
    for speed in (1.0, 0.5):
        start = blocks[-1].time[-1] + 20_000_000 if blocks else START
        healthy = run(Run(scenario.moves, 4, speed, rate=50.0, lead=1.0, seed=round(10 * speed)))
        blocks += frames(healthy.q, healthy.power, block=10, start=start)
    reference = learned(folder / "reference.yaml", blocks)
    if scenario.moves is PICK_AND_PLACE:
        course = next(c for c in courses_of(load(reference)) if c.speed == pytest.approx(scenario.speed, abs=0.02))
        table = fault_table_of_springs(scenario, course)
        (folder / "table.onnx").write_bytes(train(table, task=TrainedFor.of(course), signed=True))


def fault_table_of_springs(scenario: Scenario, course: Course) -> np.ndarray:
    """Codes (20) of a cycle with a spring on each joint in turn: the table of this task at this speed."""
    columns = []
    for joint, stiffness in enumerate(STIFFNESS, start=1):
        fault = Fault("spring", joint, stiffness)
        told = run(Run(scenario.moves, 1, scenario.speed, (fault,), rate=50.0, lead=1.0, seed=20 + joint))
        readings = Readings(told.t - told.starts[0], told.q, told.power)
        columns.append(codes_of(course.intervals, readings, Tolerance()))
    return np.stack(columns, axis=1)
