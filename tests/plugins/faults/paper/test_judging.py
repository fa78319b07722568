import numpy as np
import pytest
from bench.faults.paper import from_cycles, judge

from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.paper.codes import of_energy
from cellwatt_plugins.faults.paper.expected import Readings, fault_table
from cellwatt_plugins.faults.paper.judging import by_agreement
from tests.plugins.faults.paper.irb1200 import PICK_AND_PLACE, POLISHING, Fault, Run, period, run

TEN_PER_CENT = Tolerance(power=0.10, floor=0.0)


def cycles_of(plan):
    told = run(plan)
    length = period(plan.moves, plan.speed)
    parts = [(told.t >= start - 0.3) & (told.t < start + length - 0.3) for start in told.starts]
    return [Readings(told.t[m] - start, told.q[m], told.power[m]) for m, start in zip(parts, told.starts, strict=True)]


def expected_of(moves):
    return from_cycles(cycles_of(Run(moves, 6, lead=1.0, seed=1)))


@pytest.fixture(scope="module")
def pick_and_place():
    return expected_of(PICK_AND_PLACE)


@pytest.fixture(scope="module")
def polishing():
    return expected_of(POLISHING)


def one(moves, *faults):
    return cycles_of(Run(moves, 1, faults=faults, lead=1.0, seed=5))[0]


def judged(expected, cycle, residual="samples"):
    return judge(expected, cycle, by_agreement(fault_table(expected)), TEN_PER_CENT, residual)


def named(*given):
    return {fault.joint: fault.kind for fault in judged(*given)}


@pytest.mark.parametrize("moves", [PICK_AND_PLACE, POLISHING])
def test_intervals_are_those_of_the_plan(moves):
    expected = expected_of(moves)
    assert [interval.moving for interval in expected] == [tuple(sorted(move.by)) for move in moves]
    start = 0.0
    for interval, move in zip(expected, moves, strict=True):
        assert interval.start == pytest.approx(start, abs=0.1)
        assert interval.end == pytest.approx(start + move.seconds, abs=0.1)
        start += move.seconds + move.rest


def test_the_table_of_a_new_task_says_who_moves_when(pick_and_place):
    rows = [[int(j in move.by) for j in range(1, 7)] for move in PICK_AND_PLACE]
    assert fault_table(pick_and_place).tolist() == rows


def test_friction_is_named_by_the_intervals_in_which_its_joint_moves(pick_and_place):
    faults = judged(pick_and_place, one(PICK_AND_PLACE, Fault("friction", 5, 15.0)))
    assert [(fault.joint, fault.kind, fault.intervals) for fault in faults] == [(5, "joint", (2, 4, 5, 6))]
    assert faults[0].watts > 15


SECONDS = np.linspace(0, 2, 201)
HUNDRED = np.full(201, 100.0)
"""W."""


def energy_code(seen):
    """Code of an interval of 100 W for 2 s by its energy."""
    q = np.zeros((len(SECONDS), 1))
    return of_energy(Readings(SECONDS, q, HUNDRED), Readings(SECONDS, q, seen), TEN_PER_CENT)


@pytest.mark.parametrize(("joules", "code"), [(19, 0), (21, 1), (-19, 0), (-21, -1)])
def test_equation_20_is_about_the_energy_of_an_interval(joules, code):
    """Of 200 J, 19 J more or less are healthy and 21 J are not, whenever they come."""
    early = np.where(SECONDS < 1, 1.0, 0.0)
    assert energy_code(HUNDRED + joules / 2) == code
    assert energy_code(HUNDRED + joules * early / np.trapezoid(early, SECONDS)) == code


def test_rules_under_16_keep_to_the_samples_whatever_codes_are_about(polishing):
    """Rule 1 and 2 are printed with P(t): a dead joint that saves little energy is no faulty encoder."""
    cut = one(POLISHING, Fault("cut", 2), Fault("belt_off", 5))
    assert named(polishing, cut, "energy") == {2: "joint", 5: "joint"}
