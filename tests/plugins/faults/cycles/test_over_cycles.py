"""Faults that grow, and faults that come and go, over many cycles."""

from itertools import pairwise

import pytest

from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from tests.plugins.faults.cycles.conftest import fed
from tests.plugins.faults.cycles.four_joints import Cycle, Fault, run

EPOCH = 10**18
GROWN = 20


def told(known, cycles):
    """Alarms over all, with the number of the cycle that was over or under way."""
    book = CycleAlarms("faults", "arm", clear_after=3)
    number, out = 0, []
    for finding in fed(known, run(cycles, seed=31)):
        if finding.over:
            number += 1
            out += [(number, alarm) for alarm in book.take(finding.finding, number, EPOCH)]
        else:
            out += [(number + 1, alarm) for alarm in book.take_early(finding.finding, EPOCH)]
    assert number == len(cycles)
    return out


@pytest.mark.slow
def test_a_fault_that_grows_is_told_once_and_stays(known):
    """Friction of a joint grows from nothing to 80 % more within twenty cycles."""
    wear = [Cycle("AB"[k % 2], faults=(Fault("friction", 1, 0.8 * k / (GROWN - 1)),)) for k in range(GROWN)]
    alarms = told(known, wear)
    assert {(a.joint, a.id, a.active) for _, a in alarms} == {(2, "faults.arm.joint_2.joint_fault", True)}
    assert len({a.since for _, a in alarms}) == 1
    first = alarms[0][0]
    assert 2 < first <= GROWN // 2  # not at once, and long before it is at its worst
    assert {number for number, _ in alarms} == set(range(first, GROWN + 1))  # every cycle since renews it
    sizes = {number: a.evidence["power_residual_W"] for number, a in alarms}
    assert all(late > early for early, late in pairwise(sizes[n] for n in range(first, GROWN + 1, 2)))


def test_a_fault_that_comes_and_goes_keeps_one_alarm(known):
    """Its joint moves alone in the first move."""
    there, calm = Cycle("A", faults=(Fault("friction", 0, 1.0),)), Cycle("A")
    pattern = [there, calm, there, calm, calm, there, calm, calm, calm]
    alarms = told(known, [calm, *pattern, calm])
    assert {a.id for _, a in alarms} == {"faults.arm.joint_1.joint_fault"}
    assert len({a.since for _, a in alarms}) == 1
    assert {n for n, a in alarms if a.active} == {2, 4, 7}
    assert [n for n, a in alarms if not a.active] == [10]  # three calm cycles in a row
