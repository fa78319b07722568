from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cellwatt.stage import CellInfo
from cellwatt_plugins.faults import FaultsSettings, FaultsStage
from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.known import learn_known, stored
from cellwatt_plugins.faults.cycles.live import CycleWatch
from cellwatt_plugins.faults.cycles.recording import recording_of
from cellwatt_plugins.faults.recordings import frames_of_table
from cellwatt_plugins.faults.reference import Reference, save
from tests.plugins.faults.cycles.conftest import fed, judged, names, recorded
from tests.plugins.faults.cycles.four_joints import (
    HOME_A,
    RATE,
    TASKS,
    Cycle,
    Fault,
    Run,
    at_rest,
    describe,
    move,
    run,
)
from tests.plugins.faults.plant import START, frames, layout

SPRING = (Fault("spring", 0, 50.0),)
DEAD = (Fault("drive_cut", 3), Fault("encoder_offset", 1, 0.1))


def over(told):
    return [t.finding for t in told if t.over]


def first_told(known, faulty):
    """What is told first of a fault in the second of three cycles, and when the moves of this cycle end, s."""
    measured = run([Cycle("B"), faulty, Cycle("A")], seed=16)
    return next(t for t in fed(known, measured) if t.finding.faults), move_ends(measured, 1)


def move_ends(measured, cycle):
    """When the moves of a cycle without encoder fault ended, s."""
    inside = (measured.time >= measured.spans[cycle][0]) & (measured.time <= measured.spans[cycle][1] + 0.2)
    moving = np.abs(np.diff(measured.position[inside], axis=0)).max(axis=1) > 5e-4
    time = measured.time[inside][:-1]
    gaps = np.flatnonzero(np.diff(time[moving]) > 0.15)
    return [*time[moving][gaps], time[moving][-1]]


@pytest.mark.parametrize(
    "cycles",
    [
        [Cycle("A"), Cycle("B", faults=SPRING), Cycle("C"), Cycle("A", 0.6), Cycle("B")],
        # After a cycle with a move to another task's start, a dead joint leaves runs that no cycle claims.
        [Cycle("B"), Cycle("A", faults=(Fault("drive_cut", 0),)), Cycle("B"), Cycle("A", faults=DEAD), Cycle("C")],
    ],
)
def test_live_says_what_a_recording_says(known, cycles):
    measured = run(cycles, seed=7)
    live, offline = over(fed(known, measured)), judged(known, measured)
    assert [(c.task, c.status) for c in live] == [(c.task, c.status) for c in offline]
    assert names(live) == names(offline)
    assert [c.start for c in live] == pytest.approx([c.start for c in offline], abs=0.02)
    assert [c.end for c in live] == pytest.approx([c.end for c in offline], abs=0.02)


def test_a_cycle_that_ends_with_a_short_move_is_over_before_the_next_begins(robot, monkeypatch):
    short = np.radians(1.9)
    monkeypatch.setitem(
        TASKS, "short", (HOME_A, [{0: 0.9}, {1: 0.6, 2: -0.7}, {0: -0.9, 1: -0.6, 2: 0.7, 3: short}, {3: -short}])
    )
    known = learn_known(recorded(run([Cycle("short")] * 5, seed=2)), robot)
    measured = run([Cycle("short")] * 4, seed=8)
    watch, told = CycleWatch(known, 1 / RATE), []
    for k, time in enumerate(measured.time):
        now = slice(k, k + 1)
        told += [time for _ in watch.feed(measured.time[now], measured.position[now], measured.power[now])]
    ends = [end for _, end in measured.spans]
    assert len(told) >= 3
    assert all(end < time < end + 0.6 for end, time in zip(ends, told, strict=False))


def test_the_size_of_blocks_makes_no_difference(known):
    measured = run([Cycle("A", faults=SPRING), Cycle("B")], seed=18)
    one, many = fed(known, measured, block=4), fed(known, measured, block=500)
    assert len(one) > 2
    assert one == many


@pytest.mark.parametrize("joint, moves", [(0, 1), (3, 3)])
def test_a_faulty_joint_is_told_while_the_cycle_runs(known, joint, moves):
    """``moves`` have gone when a joint has first moved in task A."""
    first, ends = first_told(known, Cycle("A", faults=(Fault("friction", joint, 1.0 + (joint == 3)),)))
    assert not first.over
    (fault,) = first.finding.faults
    assert joint + 1 in (fault.joint, *fault.alternatives)
    assert ends[moves - 1] - 0.1 < first.finding.end < ends[moves] + 0.1


@pytest.mark.parametrize("fault", [Fault("encoder_scale", 0, 0.2), Fault("encoder_offset", 2, 0.05)])
def test_a_wrong_encoder_is_told_after_the_first_move_where_power_tells(known, fault):
    first, ends = first_told(known, Cycle("A", faults=(fault,)))
    assert names([first.finding]) == [[(fault.joint + 1, "encoder")]]
    assert first.finding.end < ends[0] + 0.1


def test_a_joint_off_its_path_is_told_while_it_is_open_what_is_wrong_with_it(known):
    """Joint 4 takes little power: whether it stands still or its encoder does, is for the moves that follow."""
    measured = run([Cycle("B"), Cycle("B", faults=(Fault("drive_cut", 3),)), Cycle("A")], seed=16)
    early = [t.finding for t in fed(known, measured) if t.finding.faults and not t.over]
    assert {fault.joint for finding in early for fault in finding.faults} == {4}
    assert early[0].end < move_ends(measured, 1)[1] + 0.1


def test_a_new_task_that_begins_like_a_known_one_has_no_faults(known):
    told = fed(known, run([Cycle("A"), Cycle("E"), Cycle("B"), Cycle("E"), Cycle("A")], seed=19))
    assert [t.finding for t in told if t.finding.faults] == []
    assert [t.finding.status for t in told] == ["healthy", "new_task", "healthy", "new_task", "healthy"]


def test_a_last_move_that_is_late_is_waited_for(known):
    measured = run([Cycle("A", faults=(Fault("drive_cut", 3),)), Cycle("A"), Cycle("B")], seed=8)
    found = over(fed(known, measured))
    assert names(found) == [[(4, "joint")], [], []]


@pytest.mark.parametrize("at, length, cycles", [(1.3, 0.4, 3), (2.4, 0.05, 3), (0.3, 2.6, 2), (1.3, 1.0, 2)])
def test_a_hole_in_the_positions_is_bridged_or_cuts_the_cycle_that_runs(known, at, length, cycles):
    """A hole of a second may hide a whole move."""
    measured = run([Cycle("A"), Cycle("A"), Cycle("B")], seed=9)
    hole = np.abs(measured.time - measured.spans[1][0] - at - length / 2) < length / 2
    gone = frames_of_table(measured.time, np.where(hole[:, None], np.nan, measured.position), measured.power)
    found = judge_recording(recording_of([gone], None, "supply.power"), known)
    assert [cycle.status for cycle in found] == ["healthy"] * cycles
    measured.position[hole] = np.nan
    for block in (7, 5000):
        live = over(fed(known, measured, block))
        assert [cycle.status for cycle in live] == ["healthy"] * cycles
        assert [c.end for c in live] == pytest.approx([c.end for c in found], abs=0.02)


@pytest.mark.parametrize(
    "task, first, last",
    [
        ("A", 1.9, 99.0),
        ("A", 1.2, 99.0),
        ("B", 1.1, 99.0),
        ("A", 0.0, 13.3),
        ("D", 0.0, 7.87),
        ("D", 0.0, 8.4),
        ("D", 0.0, 9.0),
    ],
)
def test_a_cycle_that_is_cut_has_no_faults(known, of_two_joints, task, first, last):
    """A recording, or the daemon, starts or ends within a move or a rest; the other cycle is known."""
    measured, of = run([Cycle(task)] * 2, seed=41), of_two_joints if task == "D" else known
    rows = slice(round(first * RATE), round(last * RATE))
    cut = Run(measured.time[rows], measured.position[rows], measured.power[rows], measured.spans)
    live = fed(of, cut)
    assert not any(told.finding.faults for told in live)
    assert [c.status for c in over(live)] == [c.status for c in judged(of, cut)] == ["healthy"]


@pytest.mark.parametrize("fault", [Fault("friction", 1, 0.6), Fault("encoder_offset", 1, 0.04)])
@pytest.mark.parametrize("before, after", [(0, 40), (2, 40), (40, 0), (40, 2), (2, 2)])
def test_a_recording_that_begins_or_ends_with_the_motion_of_a_cycle_keeps_it(known, fault, before, after):
    """A log with one file per cycle, started by the controller."""
    measured = run([Cycle("A", faults=(fault,))], seed=5)
    moving = np.flatnonzero(np.abs(np.diff(measured.position, axis=0)).max(axis=1) > 5e-4)
    rows = slice(moving[0] - before, moving[-1] + 1 + after)
    cut = Run(measured.time[rows], measured.position[rows], measured.power[rows], measured.spans)
    expected = [[(2, "encoder" if fault.what == "encoder_offset" else "joint")]]
    assert names(judged(known, cut)) == names(over(fed(known, cut))) == expected


@pytest.mark.parametrize(
    "joint, first, last, faulty",
    [(0, 0.0, 1.0, (1,)), (1, 4.3, 5.4, (1,)), (1, 4.3, 5.9, (1,)), (1, 4.3, 99.0, (1, 2))],
)
def test_an_encoder_that_is_stuck_in_the_first_or_last_move_is_found(of_single_joints, joint, first, last, faulty):
    """It is right again within that move, after it, after the cycle, or never; the arm waits after the first move."""
    measured = run([Cycle("F")] * 3, seed=5)
    start = measured.spans[1][0]
    stuck = (measured.time >= start + first) & (measured.time < start + last)
    measured.position[stuck, joint] = measured.position[stuck, joint][0]
    number, wait = np.arange(len(stuck)), round((start + 1.1) * RATE)
    rows = np.repeat(number, np.where(number == wait, 150, 1))
    measured = Run(np.arange(len(rows)) / RATE, measured.position[rows], measured.power[rows], [])
    expected = [[(joint + 1, "encoder")] if cycle in faulty else [] for cycle in range(3)]
    assert names(judged(of_single_joints, measured)) == expected
    assert names(over(fed(of_single_joints, measured))) == expected


@pytest.mark.parametrize(("seed", "cycle", "stop"), [(423, 3, 2305), (105, 1, 1055)])
def test_a_stop_in_a_move_is_no_fault_of_the_joints_that_move(of_single_joints, seed, cycle, stop):
    """They have gone more than half of their way, in the second or third move, which no other joint shows."""
    measured = run([Cycle("F")] * 4, seed=seed)
    begin, end = (round(RATE * time) for time in measured.spans[cycle])
    rows = np.r_[begin - 60 : stop, np.full(30, stop), stop:end]
    stopped = Run(np.arange(len(rows)) / RATE, measured.position[rows], measured.power[rows], [])
    stopped.power[rows == stop] = at_rest(measured.position[stop])
    assert [(t.over, t.finding.faults) for t in fed(of_single_joints, stopped)] == [(True, ())]


def test_a_cycle_that_is_aborted_before_its_last_move_has_no_faults(of_single_joints):
    """The arm waits, is moved by hand in three steps and back to the start pose; then the next cycle runs."""
    one, two = run([Cycle("F")] * 2, seed=5), run([Cycle("F")], seed=6)
    stop = round((one.spans[1][0] + 4.7) * RATE)
    pose = one.position[stop]
    away, near = pose + np.array([0.0, 0.0, 0.5, 0.0]), pose + np.array([0.0, -0.3, 0.5, 0.0])
    way = [pose, away, near, TASKS["F"][0]]
    parts = [(np.repeat(a[None], 200, axis=0), move(a, b, 0.8)) for a, b in pairwise(way)]
    by_hand = np.concatenate([part for pair in parts for part in pair])
    position = np.concatenate([one.position[:stop], by_hand, two.position])
    power = np.concatenate([one.power[:stop], np.full(len(by_hand), one.power[stop]), two.power])
    aborted = Run(np.arange(len(power)) / RATE, position, power, [])
    for found in (judged(of_single_joints, aborted), over(fed(of_single_joints, aborted))):
        assert [cycle.status for cycle in found] == ["healthy", "new_task", "healthy"]
        assert not any(cycle.faults for cycle in found)


@pytest.fixture
def folder(tmp_path, known, robot):
    describe(tmp_path)
    model, cycles = stored(known, robot)
    save(Reference(1, "points", "arm", "supply.power", 4, (), model, cycles), tmp_path / "ref.yaml")
    return tmp_path


def stage(folder, **settings):
    chosen = FaultsSettings(reference=Path("ref.yaml"), robot=Path("robot.yaml"), **settings)
    return FaultsStage("faults", chosen, layout(RATE, 4), CellInfo("plant", "cell", None, folder))


def alarms(faults, measured):
    blocks = frames(measured.position, measured.power, rate=RATE, block=25)
    return [alarm for block in blocks for alarm in faults.process(block, ())]


def test_the_stage_raises_and_clears(folder):
    cycles = [Cycle("A"), Cycle("A", faults=SPRING), Cycle("B"), Cycle("A"), Cycle("B")]
    measured = run(cycles, seed=11)
    found = alarms(stage(folder, clear=2), measured)
    assert [(a.kind, a.joint, a.active, a.severity) for a in found] == [
        ("joint_fault", 1, True, "error"),
        ("joint_fault", 1, True, "error"),
        ("joint_fault", 1, False, "error"),
    ]
    assert found[0].time < found[1].time
    assert found[0].id == "faults.arm.joint_1.joint_fault"
    start, end = measured.spans[1]
    assert start <= (found[0].since - START) * 1e-9 < (found[0].time - START) * 1e-9 <= end
    assert found[1].evidence["power_residual_W"] > 8


def test_the_end_of_the_frames_settles_the_last_cycle(folder):
    measured = run([Cycle("A"), Cycle("B", faults=(Fault("friction", 3, 2.0),))], seed=14)
    end = np.searchsorted(measured.time, measured.spans[1][1]) - 10
    cut = replace(measured, time=measured.time[:end], position=measured.position[:end], power=measured.power[:end])
    faults = stage(folder)
    early = alarms(faults, cut)
    assert all(alarm.time < START + measured.spans[1][1] * 1e9 - 3e8 for alarm in early)
    settled = faults.close()
    assert [(a.kind, a.joint) for a in settled if a.active] == [("joint_fault", 4)]
    assert {a.joint for a in (*early, *settled) if a.active} - {a.joint for a in settled if not a.active} == {4}


def test_nothing_is_told_while_healthy_cycles_run(known):
    changes = [Cycle("A", 1.04), Cycle("B", pause=2.0), Cycle("B", 0.6, warmth=0.15), Cycle("A", part=0.6), Cycle("C")]
    assert [t.finding for t in fed(known, run(changes, seed=17)) if t.finding.faults] == []


def test_the_stage_says_a_new_task_once(folder):
    found = alarms(stage(folder), run([Cycle("A"), Cycle("C"), Cycle("C"), Cycle("B"), Cycle("A")], seed=12))
    assert [(a.kind, a.severity, a.active) for a in found] == [("new_task", "info", True), ("new_task", "info", False)]
