"""The paper's method live, on the plant's frames; through the daemon it is tested in tests/system."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.paper.network import train
from cellwatt_plugins.faults.paper.stage import PaperFaultsSettings, PaperFaultsStage
from cellwatt_plugins.faults.tables import PICK_AND_PLACE as TABLE_I
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.plugins.faults.paper.frames import frames_of
from tests.plugins.faults.paper.irb1200 import POLISHING, Fault, Run, period, run
from tests.plugins.faults.plant import START
from tests.plugins.faults.watching import learned

CUT, BELT = Fault("cut", 2), Fault("belt_off", 5)
CREEP = Fault("encoder_creep", 2, 0.1)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Polishing at both speeds."""
    blocks = frames_of(run(Run(POLISHING, 4, 1.0, rate=50.0, lead=1.0, seed=1)))
    slow = run(Run(POLISHING, 4, 0.5, rate=50.0, lead=1.0, seed=2))
    blocks += frames_of(slow, start=int(blocks[-1].time[-1]) + 20_000_000)
    return learned(tmp_path_factory.mktemp("paper") / "reference.yaml", blocks)


def watch(reference: Path, told, block=10, **settings):
    cell = CellInfo("plant", "cell", None, reference.parent)
    blocks = frames_of(told, block=block)
    segment = SegmentStage("segment", SegmentSettings(), blocks[0].layout, cell)
    chosen = PaperFaultsSettings(reference=Path(reference.name), **settings)
    stage = PaperFaultsStage("faults", chosen, blocks[0].layout, cell)
    return [alarm for frames in blocks for alarm in stage.process(frames, segment.process(frames, ()))]


def plan(speed, *faults, cycles=3, since=1, seed=7, lead=1.0):
    return run(Run(POLISHING, cycles, speed, faults, since, rate=50.0, lead=lead, seed=seed))


@pytest.mark.parametrize("speed", [1.0, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_healthy_running_gives_no_alarm(reference, speed, seed):
    assert watch(reference, plan(speed, seed=seed, cycles=4)) == []


@pytest.mark.parametrize("speed", [1.0, 0.5])
@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ((CUT, BELT), {(2, "joint_fault"), (5, "joint_fault")}),
        ((CUT, BELT, CREEP), {(2, "joint_and_encoder_fault"), (5, "joint_fault")}),
        ((Fault("encoder_offset", 6, 0.05),), {(6, "encoder_fault")}),
    ],
)
def test_faults_are_named_after_the_first_interval(reference, speed, faults, expected):
    alarms = watch(reference, plan(speed, *faults))
    assert {(alarm.joint, alarm.kind) for alarm in alarms if alarm.active} == expected
    begun = 1.0 + period(POLISHING, speed)
    for alarm in alarms[: len(expected)]:
        assert begun - 0.1 < (alarm.since - START) * 1e-9 < begun + 0.1
        assert (alarm.time - START) * 1e-9 < begun + POLISHING[0].seconds / speed + 0.1
        assert alarm.evidence["task_intervals"] == [1]
        assert alarm.evidence["speed"] == pytest.approx(speed, abs=0.02)


def test_blocks_of_any_size_give_the_same_alarms(reference):
    told = plan(1.0, CUT, BELT)
    expected = watch(reference, told, block=10)
    assert expected
    assert watch(reference, told, block=3) == watch(reference, told, block=2000) == expected


def test_an_alarm_is_cleared_by_a_healthy_cycle(reference):
    faulty = plan(1.0, CUT, cycles=1, since=0)
    healthy = plan(1.0, cycles=2)
    step = 0.02
    told = replace(
        faulty,
        t=np.concatenate([faulty.t, faulty.t[-1] + step + healthy.t]),
        q=np.concatenate([faulty.q, healthy.q]),
        power=np.concatenate([faulty.power, healthy.power]),
    )
    alarms = watch(reference, told)
    assert alarms[0].active
    assert not alarms[-1].active
    assert {alarm.id for alarm in alarms} == {"faults.arm.joint_2.joint_fault"}
    assert alarms[-1].since == alarms[0].since


def test_a_cycle_with_missing_frames_is_not_judged(reference):
    told = plan(1.0, CUT, BELT, cycles=1, since=0)
    missing = (told.t > 1.4) & (told.t < 1.7)
    power = np.where(missing, np.nan, told.power)
    assert watch(reference, replace(told, power=power)) == []


def test_a_cycle_whose_beginning_was_not_seen_is_not_judged(reference):
    told = plan(1.0, CUT, BELT, cycles=1, since=0)
    seen = told.t > 1.05
    late = replace(told, t=told.t[seen] - told.t[seen][0], q=told.q[seen], power=told.power[seen])
    assert watch(reference, late) == []


def test_a_network_names_joints_of_tasks_with_as_many_intervals_only(reference):
    (reference.parent / "six.onnx").write_bytes(train(TABLE_I))
    friction = Fault("friction", 5, 20.0)
    told = plan(1.0, friction)
    compared = watch(reference, told)
    assert {alarm.joint for alarm in compared} == {5}
    assert watch(reference, told, network=Path("six.onnx")) == compared


def test_a_wrong_reference_is_refused(tmp_path):
    (tmp_path / "reference.yaml").write_text("{}")
    with pytest.raises(ModelError, match="not a file made by"):
        watch(tmp_path / "reference.yaml", plan(1.0, cycles=1))
