"""The demo's arm beside its simulation: the spring that is hooked on is named with its numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt.demo import fault, simulation
from cellwatt.emulation import ArmSignals
from cellwatt.tables import read_table
from tests.blocks import frames_of, layout_of
from tests.daemon.record.making import SESSION, write_chunks

EPOCH = SESSION * 1e-9 - 40.0
"""The emulated arm has run for 40 s when the recording begins."""
UNITS = {"position": "rad", "velocity": "rad/s", "current": "A"}


def record(folder: Path, seconds: float) -> None:
    """A recording of the demo's arm with the spring on its elbow, frames at 50 Hz."""
    layout = layout_of({f"arm.joint_{i}.{quantity}": unit for quantity, unit in UNITS.items() for i in range(1, 7)})
    time = SESSION + np.arange(int(seconds * 50)) * layout.step
    arm = ArmSignals()
    arm.disturb({"spring": fault.JOINT, **fault.SPRING, "at": 0.0})
    seen = arm.at(time * 1e-9 - EPOCH)
    values = np.column_stack([seen[channel.short] for channel in layout.channels])
    write_chunks(folder, [[frames_of(layout, 0, time, values)]])


def test_what_explain_gets_is_the_recording_and_the_arm_without_its_spring(tmp_path: Path) -> None:
    record(tmp_path, 9.0)
    since = EPOCH + 41.0
    recording, simulated = simulation.write_run(tmp_path, tmp_path / "out", EPOCH, since, since + 7.0)
    read, told = read_table(recording), read_table(simulated)
    assert len(read.time) == len(told.time) == pytest.approx(350, abs=2)
    healthy = ArmSignals()
    torque, _ = healthy.torque(read.time + 41.0, *healthy.motion(read.time + 41.0))
    np.testing.assert_allclose(told.joints("torque"), torque, atol=1e-3)
    elbow = (read.joints("current") * healthy.torque_constant - torque)[:, fault.JOINT - 1]
    stretched = read.joints("position")[:, fault.JOINT - 1] - fault.SPRING["rest"]
    assert np.polyfit(stretched, elbow, 1)[0] == pytest.approx(fault.SPRING["stiffness"], rel=0.02)


@pytest.mark.slow
async def test_explain_names_the_spring(tmp_path: Path) -> None:
    record(tmp_path, 18.0)
    since = EPOCH + 40.5
    found = await simulation.compared(tmp_path, "spring", EPOCH, since, since + 17.0)
    assert found.startswith(f"Joint {fault.JOINT} is pulled with 60")
    assert "a spring" in found
    assert (tmp_path / simulation.REPORTS / "spring" / "report.html").exists()
