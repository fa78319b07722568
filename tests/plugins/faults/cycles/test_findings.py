from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.known import learn_known
from cellwatt_plugins.faults.cycles.recording import Recording, recording_of
from cellwatt_plugins.faults.cycles.runs import find_runs
from cellwatt_plugins.faults.recordings import frames_of_table
from cellwatt_plugins.robot import Arm
from tests.plugins.faults.cycles.conftest import HEALTHY, judged, names, recorded
from tests.plugins.faults.cycles.four_joints import RATE, STANDBY, Cycle, Fault, describe, run


def of_cycles(known, *cycles):
    """Findings with the healthy cycles around the ones in question left out."""
    measured = run([Cycle("B"), *cycles, Cycle("A")], seed=20)
    found = judged(known, measured)
    assert len(found) == len(cycles) + 2
    for (start, end), cycle in zip(measured.spans, found, strict=True):
        assert start - 0.1 < cycle.start < cycle.end < end + 0.1
    assert [found[0].status, found[-1].status] == ["healthy", "healthy"]
    return found[1:-1]


OTHERWISE = "power is as in healthy cycles"


@pytest.mark.parametrize(
    "fault, kind, text, watts",
    [
        (Fault("spring", 0, 40.0), "joint", "works against a force that grows with its angle", 5.0),
        (Fault("friction", 3, 2.0), "joint", "turns harder", 5.0),
        (Fault("drive_cut", 0), "joint", "stands still and takes no power", 5.0),
        (Fault("belt_off", 3), "joint", "stands still", 5.0),
        (Fault("winding", 1, 6.0), "joint", "winding", 5.0),
        (Fault("spring", 0, 400.0), "joint", "works against a force that grows with its angle", 60.0),
        (Fault("friction", 2, 4.0), "joint", "turns harder", 60.0),
        (Fault("encoder_stuck", 1), "encoder", OTHERWISE, 0.0),
        (Fault("encoder_scale", 2, 0.1), "encoder", OTHERWISE, 0.0),
        (Fault("encoder_offset", 1, 0.04), "encoder", OTHERWISE, 0.0),
    ],
)
def test_a_fault_is_named_and_a_large_one_is_not_shared_out_to_two_joints(known, fault, kind, text, watts):
    (cycle,) = found = of_cycles(known, Cycle("A", faults=(fault,)))
    assert names(found) == [[(fault.joint + 1, kind)]]
    assert cycle.status == "fault"
    assert text in cycle.faults[0].statement
    assert cycle.faults[0].confidence > 0.9
    assert cycle.faults[0].size_watt >= watts


@pytest.mark.parametrize(
    "first, second",
    [
        (Fault("encoder_offset", 0, 0.1), Fault("encoder_scale", 2, 0.15)),
        (Fault("encoder_offset", 0, -0.06), Fault("drive_cut", 2)),
    ],
)
def test_a_task_is_known_though_every_joint_that_moves_is_faulty(of_two_joints, first, second):
    measured = run([Cycle("B"), Cycle("D", faults=(first, second)), Cycle("B")], seed=22)
    found = judged(of_two_joints, measured)
    assert names(found) == [[], [(1, "encoder"), (3, "joint" if second.what == "drive_cut" else "encoder")], []]


def test_a_new_task_of_the_same_two_joints_is_new(of_two_joints):
    measured = run([Cycle("B"), Cycle("D2"), Cycle("B")], seed=23)
    found = judged(of_two_joints, measured)
    assert [cycle.status for cycle in found] == ["healthy", "new_task", "healthy"]


def test_two_faults_at_once(known):
    both = (Fault("friction", 1, 1.0), Fault("encoder_offset", 3, 0.05))
    other = (Fault("spring", 0, 40.0), Fault("friction", 2, 1.2))
    same = (Fault("friction", 1, 1.0), Fault("encoder_offset", 1, 0.05))
    found = names(of_cycles(known, *(Cycle("A", faults=faults) for faults in (both, other, same))))
    assert found == [[(2, "joint"), (4, "encoder")], [(1, "joint"), (3, "joint")], [(2, "joint_and_encoder")]]


def test_it_says_where_and_how_much(known):
    truth, healthy = run([Cycle("A", faults=(Fault("friction", 1, 1.0),))], noise=0.0), run([Cycle("A")], noise=0.0)
    (cycle,) = of_cycles(known, Cycle("A", faults=(Fault("friction", 1, 1.0),)))
    assert cycle.faults[0].intervals == (2, 5)
    assert cycle.faults[0].size_watt == pytest.approx(abs(truth.power - healthy.power).max(), rel=0.15)


@pytest.mark.parametrize("speed", [0.6, 1.0])
def test_what_is_harmless_is_no_fault(known, speed):
    changes = [
        Cycle("A", speed * 1.04),
        Cycle("A", speed * 0.96),
        Cycle("B", speed, pause=2.5),
        Cycle("B", speed, warmth=0.15),
        Cycle("A", speed, part=0.6),
        Cycle("A", speed),
    ]
    found = of_cycles(known, *changes)
    assert [cycle.faults for cycle in found] == [()] * 6
    notes = [cycle.note for cycle in found]
    assert "4% faster" in notes[0]
    assert "4% slower" in notes[1]
    assert "paused for 2.5 s" in notes[2]
    assert "the arm is colder" in notes[3]
    assert notes[5] == ""


def test_what_a_heavy_arm_carries_may_change_by_as_much_more(tmp_path):
    """All power but the standing power is that of the four joints, ten times, as of an arm of ten times the mass."""

    def heavier(cycles, seed):
        measured = run(cycles, seed, noise=0.1)
        return replace(measured, power=STANDBY + 10.0 * (measured.power - STANDBY))

    known = learn_known(recorded(heavier(HEALTHY, 1)), Arm.load(describe(tmp_path, 10.0)))
    cycles = [
        Cycle("A", part=0.6),
        Cycle("B", 0.6, part=-0.4),
        Cycle("A"),
        Cycle("A", faults=(Fault("friction", 3, 1.0),)),
    ]
    found = judged(known, heavier(cycles, 20))
    assert names(found) == [[], [], [], [(4, "joint")]]
    assert [cycle.note.partition(" by ")[0] for cycle in found[:3]] == ["part heavier", "part lighter", ""]


@pytest.mark.parametrize("late, watts", [(1.31, 8.0), (2.62, -6.0), (4.13, 3.0), (3.0, 25.0)])
def test_a_load_of_the_supply_that_switches_during_a_cycle_is_no_fault(known, late, watts):
    """As the controller's fan does."""
    measured = run([Cycle("A"), Cycle("A"), Cycle("A", faults=(Fault("friction", 3, 2.0),))], seed=25)
    measured.power[measured.time > measured.spans[1][0] + late] += watts
    found = judged(known, measured)
    assert names(found) == [[], [], [(4, "joint")]]
    assert (
        found[1].note == f"the supply takes {abs(watts):.0f} W {'more' if watts > 0 else 'less'}, as if a fan switched"
    )


@pytest.mark.parametrize("seconds", [0.7, 20.0])
def test_a_move_that_stops_on_its_way_is_no_fault(known, seconds):
    """The stop is in the first move."""
    measured = run([Cycle("A"), Cycle("A"), Cycle("B")], seed=24)
    number, stop = np.arange(len(measured.time)), round((measured.spans[1][0] + 0.6) * RATE)
    rows = np.repeat(number, np.where(number == stop, round(seconds * RATE), 1))
    power = np.where(rows == stop, measured.power[0], measured.power[rows])
    found = judge_recording(Recording(np.arange(len(rows)) / RATE, measured.position[rows], power), known)
    assert [cycle.faults for cycle in found] == [()] * 3
    assert found[1].note == f"paused for {seconds:.1f} s"
    (start, end), later = measured.spans[1], measured.spans[2][0] + seconds
    assert start < found[1].start < start + 0.2 and end < found[1].end + 0.4 < found[2].start < later + 0.2


@pytest.mark.parametrize("shares", [(0.3, 0.65), (0.25, 0.45, 0.7)])
def test_a_move_with_several_stops_is_a_pause(known, shares):
    """The stops of 1.5 s are in the second move; joint 4 turns harder in the third."""
    measured = run([Cycle("A"), Cycle("A", faults=(Fault("friction", 3, 2.0),)), Cycle("B")], seed=26)
    second = [r for r in find_runs(recorded(measured)) if measured.time[r.first] > measured.spans[1][0]][1]
    stops = [round(second.first + share * (second.last - second.first)) for share in shares]
    number = np.arange(len(measured.time))
    rows = np.repeat(number, np.where(np.isin(number, stops), round(1.5 * RATE), 1))
    power = np.where(np.isin(rows, stops), measured.power[0], measured.power[rows])
    found = judge_recording(Recording(np.arange(len(rows)) / RATE, measured.position[rows], power), known)
    assert names(found) == [[], [(4, "joint")], []]
    assert found[1].note == f"paused for {1.5 * len(shares):.1f} s"


def test_a_cycle_without_power_is_not_judged(known):
    measured = run([Cycle("B"), Cycle("A", faults=(Fault("encoder_scale", 0, 0.2),)), Cycle("A")], seed=21)
    start, end = measured.spans[1]
    measured.power[(measured.time > start) & (measured.time < end - 1.0)] = np.nan
    found = judged(known, measured)
    assert [(cycle.status, cycle.faults) for cycle in found] == [("healthy", ()), ("changed", ()), ("healthy", ())]
    assert "power is missing" in found[1].note


def test_power_that_no_healthy_cycle_has_is_refused(healthy, robot):
    with pytest.raises(ModelError, match="power is missing at the same point of every healthy cycle"):
        learn_known(replace(healthy, power=np.full_like(healthy.power, np.nan)), robot)


def test_days_between_files_take_no_memory_and_times_stay(known):
    measured = run([Cycle("A"), Cycle("B")], seed=20)
    late = np.where(measured.time > measured.spans[0][1] + 0.4, 300_000.0, 0.0)
    frames = frames_of_table(measured.time + late, measured.position, measured.power)
    recording = recording_of([frames], None, "supply.power")
    assert len(recording.time) < len(frames) + 6100
    one, two = judge_recording(recording, known)
    assert [one.status, two.status] == ["healthy", "healthy"]
    assert two.start == pytest.approx(300_000.0 + measured.spans[1][0] + 0.1, abs=0.1)
