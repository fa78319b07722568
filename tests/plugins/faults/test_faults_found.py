"""Each fault on each joint of the plant is found, named and cleared."""

import math

import pytest

from tests.plugins.faults.plant import Cycle, Fault, frames, recorded, run
from tests.plugins.faults.watching import more, watch
from tests.plugins.segment.motions import since_start

HEALTHY, FAULTY, AFTER = 3, 3, 4


def alarms_of(reference, *faults, seed=2, counts=(HEALTHY, FAULTY, AFTER)):
    """Alarms of so many healthy cycles, cycles with these faults and healthy cycles, and when each cycle begins, s."""
    kinds = (Cycle(), Cycle(faults=faults), Cycle())
    positions, power, starts = run([each for each, n in zip(kinds, counts, strict=True) for _ in range(n)], seed=seed)
    return watch(reference, frames(positions, power)), starts


def standing(alarms, time):
    """What is up at a time, s: kind, joint."""
    up = {alarm.id: alarm for alarm in alarms if since_start(alarm.time) <= time}
    return {(a.kind, a.joint) for a in up.values() if a.active}


KINDS = [
    ("spring", 40.0, "joint_fault"),
    ("friction", 25.0, "joint_fault"),
    ("cut", 0.0, "joint_fault"),
    ("encoder_offset", 0.06, "encoder_fault"),
    ("encoder_scale", 0.9, "encoder_fault"),
    ("encoder_stuck", 0.0, "encoder_fault"),
]
ONCE = [(*kind, 1 + i % 3) for i, kind in enumerate(KINDS)]
"""Each kind on one joint, each joint with two kinds; the other joints are among the slow ones."""
OTHERS = [(*kind, joint) for kind in KINDS for joint in (1, 2, 3) if (*kind, joint) not in ONCE]


@pytest.mark.parametrize(("kind", "size", "expected", "joint"), [*ONCE, *more(*OTHERS)])
def test_it_is_named_within_a_cycle_and_cleared_after(reference, joint, kind, size, expected):
    alarms, starts = alarms_of(reference, Fault(kind, joint, size))
    begin, second, last = starts[HEALTHY], starts[HEALTHY + 1], starts[HEALTHY + FAULTY]
    assert standing(alarms, begin - 0.3) == set()
    assert standing(alarms, second + 1.5) == {(expected, joint)}
    assert standing(alarms, last) == {(expected, joint)}
    assert standing(alarms, 1e9) == set()


@pytest.mark.parametrize("seed", [0, 1, *more(2, 3)])
def test_of_joints_that_move_together_the_faulty_one_is_named_at_the_end_of_the_cycle(reference, seed):
    alarms, starts = alarms_of(reference, Fault("friction", 3, 25.0), seed=seed)
    first = alarms[0]  # joints 2 and 3 move together first
    assert {first.joint, *first.alternatives} == {2, 3}
    assert standing(alarms, starts[HEALTHY + 1] + 0.5) == {("joint_fault", 3)}
    assert all(3 in (a.joint, *a.alternatives) for a in alarms)
    assert standing(alarms, 1e9) == set()


@pytest.mark.slow
def test_two_faults_are_both_named(reference):
    both = (Fault("friction", 1, 25.0), Fault("friction", 2, 25.0))
    alarms, starts = alarms_of(reference, *both, seed=5, counts=(2, 3, 0))
    assert standing(alarms, starts[3]) == {("joint_fault", 1), ("joint_fault", 2)}
    assert standing(alarms, 1e9) == {("joint_fault", 1), ("joint_fault", 2)}


def test_an_encoder_and_another_joint_are_both_named(reference):
    both = (Fault("friction", 1, 25.0), Fault("encoder_offset", 3, 0.04))
    alarms, starts = alarms_of(reference, *both, seed=5, counts=(2, 3, 0))
    assert standing(alarms, starts[4]) >= {("joint_fault", 1)}
    assert {a.joint for a in alarms if a.active and a.kind != "joint_fault"} == {3}


def test_of_two_encoders_each_alarm_gives_its_own_deviation(reference):
    both = {2: 0.03, 3: 0.05}
    faults = (Fault("encoder_offset", joint, size) for joint, size in both.items())
    alarms, _ = alarms_of(reference, *faults, seed=5, counts=(2, 2, 0))
    found = {alarm.joint: alarm.statement for alarm in alarms}
    assert set(found) == set(both)
    assert all(f"joint {j} is off the path by up to {math.degrees(both[j]):.1f}°" in text for j, text in found.items())


def test_a_fault_at_a_learned_lower_speed(rich_reference):
    cycles = [Cycle(speed=0.6)] * 2 + [Cycle(speed=0.6, faults=(Fault("friction", 1, 25.0),))] * 2
    alarms = watch(rich_reference, recorded(cycles, seed=8))
    assert {(a.kind, a.joint) for a in alarms} == {("joint_fault", 1)}
    assert all(a.evidence["speed"] == pytest.approx(0.6, abs=0.01) for a in alarms)
