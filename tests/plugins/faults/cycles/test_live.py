from pathlib import Path

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults import FaultsSettings, FaultsStage
from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.known import stored
from cellwatt_plugins.faults.cycles.live import CycleWatch
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.reference import Reference, save
from tests.plugins.faults.cycles.arm_of_points import RATE, Cycle, Fault, describe, run

SPRING = (Fault("spring", 0, 50.0),)
START = 1_700_000_000_000_000_000
LAYOUT = Layout(
    (
        *(FrameChannel(f"arm.joint_{j}.position", "rad", "continuous", "linear") for j in range(1, 5)),
        FrameChannel("meter.supply.power", "W", "continuous", "average"),
    ),
    RATE,
)


def fed(known, measured, block=20):
    watch = CycleWatch(known, 1 / RATE)
    found = []
    for i in range(0, len(measured.time), block):
        part = slice(i, i + block)
        found += watch.feed(measured.time[part], measured.position[part], measured.power[part])
    return found


def test_live_says_what_a_recording_says(known):
    measured = run([Cycle("A"), Cycle("B", faults=SPRING), Cycle("C"), Cycle("A", 0.6), Cycle("B")], seed=7)
    live = fed(known, measured)
    offline = judge_recording(Recording(measured.time, measured.position, measured.power), known)
    assert [(c.task, c.status, [(f.joint, f.kind) for f in c.faults]) for c in live] == [
        (c.task, c.status, [(f.joint, f.kind) for f in c.faults]) for c in offline
    ]
    assert [c.start for c in live] == pytest.approx([c.start for c in offline], abs=0.02)


def test_a_last_move_that_is_late_is_waited_for(known):
    measured = run([Cycle("A", faults=(Fault("drive_cut", 3),)), Cycle("A"), Cycle("B")], seed=8)
    found = fed(known, measured)
    assert [[(f.joint, f.kind) for f in cycle.faults] for cycle in found] == [[(4, "joint")], [], []]


def test_a_hole_cuts_the_cycle_that_runs(known):
    measured = run([Cycle("A"), Cycle("A"), Cycle("A")], seed=9)
    start, end = measured.spans[1]
    hole = (measured.time > start + 1.5) & (measured.time < end - 2.0)
    measured.position[hole] = np.nan
    found = fed(known, measured)
    assert [(round(c.start), c.status) for c in found if c.task != "new"] == [
        (round(measured.spans[0][0]), "healthy"),
        (round(measured.spans[2][0]), "healthy"),
    ]
    assert not any(cycle.faults for cycle in found)


@pytest.fixture
def folder(tmp_path, known, robot):
    describe(tmp_path)
    model, cycles = stored(known, robot)
    save(Reference(1, "points", "arm", "supply.power", 4, (), model, cycles), tmp_path / "ref.yaml")
    return tmp_path


def stage(folder, **settings):
    chosen = FaultsSettings(reference=Path("ref.yaml"), robot=Path("robot.yaml"), **settings)
    return FaultsStage("faults", chosen, LAYOUT, CellInfo("plant", "cell", None, folder))


def alarms(faults, measured):
    values = np.column_stack([measured.position, measured.power])
    time = START + np.round(measured.time * 1e9).astype(np.int64)
    out = []
    for i in range(0, len(time), 25):
        part = slice(i, i + 25)
        zeros = np.zeros(values[part].shape)
        block = Frames(LAYOUT, i, time[part], values[part], zeros.astype(np.uint8), zeros.astype(np.int64))
        out += faults.process(block, ())
    return out


def test_the_stage_raises_and_clears(folder):
    cycles = [Cycle("A"), Cycle("A", faults=SPRING), Cycle("B"), Cycle("A"), Cycle("B")]
    measured = run(cycles, seed=11)
    found = alarms(stage(folder, clear=2), measured)
    assert [(a.kind, a.joint, a.active, a.severity) for a in found] == [
        ("joint_fault", 1, True, "error"),
        ("joint_fault", 1, False, "error"),
    ]
    assert found[0].id == "faults.arm.joint_1.joint_fault"
    start, end = measured.spans[1]
    assert start <= (found[0].since - START) * 1e-9 < (found[0].time - START) * 1e-9 <= end
    assert found[0].evidence["power_residual_W"] > 8


def test_the_stage_says_a_new_task_once(folder):
    found = alarms(stage(folder), run([Cycle("A"), Cycle("C"), Cycle("C"), Cycle("B"), Cycle("A")], seed=12))
    assert [(a.kind, a.severity, a.active) for a in found] == [("new_task", "info", True), ("new_task", "info", False)]


def test_a_reference_without_cycles_is_refused(folder, known):
    save(Reference(1, "points", "arm", "supply.power", 4, ()), folder / "ref.yaml")
    with pytest.raises(ModelError, match="learn it again with --robot"):
        stage(folder)
