"""The example cell with a network of faults, live: the network names the elbow on which a spring is hooked."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from cellwatt.emulation import ArmSignals, EmulatorProcess
from cellwatt.registry import available
from tests.system.running import Audience, Daemon

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ELBOW, STIFFNESS = 3, 80.0

pytestmark = [
    pytest.mark.system,
    pytest.mark.slow,  # a whole cycle without a hole of 0.1 s: not on a machine that is short of processor time
    pytest.mark.timeout(180),
    pytest.mark.skipif(
        "faults_by_paper" not in available("cellwatt.stages"),
        reason="the stage faults_by_paper is not registered: install the package again",
    ),
]


async def test_the_example_names_the_elbow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(EXAMPLES / "demo-reference.yaml", tmp_path)
    shutil.copytree(EXAMPLES / "fault-networks", tmp_path / "fault-networks")
    text = (EXAMPLES / "fault-networks.yaml").read_text()
    cell = text[text.index("sources:") : text.index("zenoh:")]
    common = ("--epoch", str(time.time()))
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0", *common) as arm,
        EmulatorProcess("power_board", "--listen", "pty", *common) as board,
    ):
        for device in (arm, board):
            await device.disturb(spring=float(ELBOW), stiffness=STIFFNESS, rest=ArmSignals().home[ELBOW - 1], at=0.0)
        host, _, port = arm.address.rpartition(":")
        for name, value in {"ARM_HOST": host, "ARM_PORT": port, "BOARD_PORT": board.address}.items():
            monkeypatch.setenv(name, value)
        async with Daemon(tmp_path, cell) as daemon, Audience(daemon, ("alarm", "health")) as audience:
            await audience.until(lambda a: any(alarm.kind.endswith("_fault") for alarm in a.alarms), 100)
            (alarm,) = [alarm for alarm in audience.alarms if alarm.kind.endswith("_fault")][:1]
    assert (alarm.joint, alarm.kind, alarm.alternatives) == (ELBOW, "joint_fault", ())
    assert {2, 5} <= set(alarm.evidence["task_intervals"])  # those in which the elbow moves; a taut spring loads others
