"""The paper's method live, on the plant's frames; through the daemon it is tested in tests/system."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from bench.faults.tables import PICK_AND_PLACE as TABLE_I
from click.testing import CliRunner

from cellwatt.commands.check import command as check
from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper.course import courses_of
from cellwatt_plugins.faults.paper.expected import fault_table
from cellwatt_plugins.faults.paper.network import train
from cellwatt_plugins.faults.paper.stage import PaperFaultsStage
from cellwatt_plugins.faults.paper.trained_for import TrainedFor
from cellwatt_plugins.faults.reference import load
from tests.plugins.faults import watching
from tests.plugins.faults.paper.irb1200 import POLISHING, Fault, Run, period, run
from tests.plugins.faults.plant import START, frames
from tests.plugins.faults.watching import learned

CUT, BELT = Fault("cut", 2), Fault("belt_off", 5)
CREEP = Fault("encoder_creep", 2, 0.1)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Polishing at both speeds."""
    blocks = after(plan(1.0, cycles=4, seed=1), plan(0.5, cycles=4, seed=2))
    return learned(tmp_path_factory.mktemp("paper") / "reference.yaml", blocks)


watch = partial(watching.watch, kind=PaperFaultsStage)


def plan(speed, *faults, cycles=3, since=1, seed=7, block=10):
    """Frames of polishing, with faults from a cycle on."""
    told = run(Run(POLISHING, cycles, speed, faults, since, rate=50.0, lead=1.0, seed=seed))
    return frames(told.q, told.power, block=block)


def after(first, second):
    """Frames one after the other."""
    late = first[-1].time[-1] + 20_000_000 - second[0].time[0]
    return first + [replace(block, time=block.time + late) for block in second]


def test_healthy_running_gives_no_alarm(reference):
    assert watch(reference, plan(0.5, cycles=4)) == []


@pytest.mark.parametrize("speed", [1.0, 0.5])
@pytest.mark.parametrize(
    ("faults", "expected"),
    [
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
    expected, *others = (watch(reference, plan(1.0, CUT, BELT, block=block)) for block in (10, 3, 2000))
    assert expected
    assert others == [expected] * 2


def test_an_alarm_is_cleared_by_a_healthy_cycle(reference):
    alarms = watch(reference, after(plan(1.0, CUT, cycles=1, since=0), plan(1.0, cycles=2)))
    assert alarms[0].active
    assert not alarms[-1].active
    assert {alarm.id for alarm in alarms} == {"faults.arm.joint_2.joint_fault"}
    assert alarms[-1].since == alarms[0].since


def test_a_cycle_whose_beginning_was_not_seen_is_not_judged(reference):
    frames = plan(1.0, CUT, BELT, cycles=1, since=0, block=1)
    assert watch(reference, frames[53:]) == []  # the cycle begins after 50 frames


FALLS = Fault("friction", 5, -20.0)
"""Joint 5 runs easier than it should: power falls, and encoders keep their path."""


def polishing(reference):
    """The task at full speed as the reference has it."""
    return next(course for course in courses_of(load(reference)) if course.speed == 1.0)


def with_network(reference, told, content):
    (reference.parent / "table.onnx").write_bytes(content)
    return watch(reference, told, network=Path("table.onnx"))


@pytest.mark.parametrize("size", [20.0, -20.0])
def test_a_network_names_what_is_named_without_it_whether_power_rises_or_falls(reference, size):
    told = plan(1.0, replace(FALLS, size=size))
    compared = watch(reference, told)
    assert {alarm.joint for alarm in compared} == {5}
    course = polishing(reference)
    of_the_motion = train(fault_table(course.intervals), task=TrainedFor.of(course))
    named = with_network(reference, told, of_the_motion)
    assert {(alarm.joint, alarm.kind) for alarm in named if alarm.active} == {(5, "joint_fault")}
    assert named[0].time == compared[0].time


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: replace(t, moving=((1, 2, 5), *t.moving[1:])), "in interval 1: 1, 2, 5, 6, expected 1, 2, 5"),
        (lambda t: replace(t, way=(t.way[0], t.way[2], *t.way[2:])), "another way in interval 2"),
        (lambda t: replace(t, seconds=tuple(1.5 * s for s in t.seconds)), "another pace in interval"),
    ],
)
def test_a_network_of_another_task_with_as_many_intervals_is_refused(reference, change, reason):
    course = polishing(reference)
    content = train(fault_table(course.intervals), task=change(TrainedFor.of(course)))
    with pytest.raises(ModelError, match=f"none of reference .*{reason}"):
        with_network(reference, plan(1.0, cycles=1), content)


def test_a_folder_has_a_network_for_each_speed_and_no_two_for_one(reference, tmp_path):
    for course in courses_of(load(reference)):
        content = train(fault_table(course.intervals), task=TrainedFor.of(course))
        (tmp_path / f"{course.speed}.onnx").write_bytes(content)
    for speed in (1.0, 0.5):
        assert {alarm.joint for alarm in watch(reference, plan(speed, FALLS), network=tmp_path)} == {5}
    (tmp_path / "again.onnx").write_bytes(content)
    with pytest.raises(ModelError, match=r"again\.onnx: is for task_1 at .*, as is .*onnx: keep one"):
        watch(reference, plan(1.0, cycles=1), network=tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ModelError, match=r"no \.onnx file in this folder"):
        watch(reference, plan(1.0, cycles=1), network=empty)


def test_check_refuses_a_network_that_does_not_fit_in_one_line_with_its_place(reference):
    (reference.parent / "table.onnx").write_bytes(train(TABLE_I))
    cell = reference.parent / "cell.yaml"
    cell.write_text(
        "site: plant\ncell: cell\nsources:\n"
        "  arm: {driver: ur, host: 192.0.2.10}\n  board: {driver: power_board, port: /dev/ttyUSB0, rate: 123 Hz}\n"
        "stages:\n  segment: {arm: arm}\n"
        "  faults:\n    stage: faults_by_paper\n    reference: reference.yaml\n    power: board.supply.power\n"
        "    network: table.onnx\n"
    )
    found = CliRunner().invoke(check, [str(cell)])
    assert found.exit_code == 2
    lines = found.output.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{cell}:8:3: stages.faults: fault network ")
    assert lines[0].endswith("names no task; train it with `cellwatt faults train`")
