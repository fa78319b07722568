from dataclasses import replace

import pytest

from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.cycles.findings import NOT_JUDGED, CycleFinding, FaultFinding

EPOCH = 10**18
CALM = CycleFinding(0.0, 8.0, "task_1", 1.0, "healthy", "", ())


def fault(joint, confidence=0.999, alternatives=()):
    return FaultFinding(joint, "joint", (1,), 12.0, confidence, alternatives, f"Joint {joint} turns harder.")


def cycle(*faults, end=8.0):
    return replace(CALM, status="fault" if faults else "healthy", faults=faults, end=end)


def told(alarms):
    return [(a.joint, a.active, a.severity) for a in alarms]


@pytest.fixture
def book():
    return CycleAlarms("faults", "arm", clear_after=2)


def test_an_early_alarm_goes_where_the_whole_cycle_names_another(book):
    early = book.take_early(cycle(fault(3, 0.7, (2,)), end=3.0), EPOCH)
    whole = book.take(cycle(fault(2)), 1, EPOCH)
    assert told(early) == [(3, True, "warning")]
    assert told(whole) == [(2, True, "error"), (3, False, "warning")]
    assert "explained without this fault" in whole[1].statement


def test_an_early_alarm_of_an_aborted_cycle_stays_until_enough_cycles_are_without_its_fault(book):
    book.take_early(cycle(fault(3), end=3.0), EPOCH)
    jogged = replace(CALM, status="new_task", end=20.0)
    later = [replace(CALM, start=start, end=start + 8.0) for start in (30.0, 40.0)]
    unjudged = replace(CALM, start=50.0, end=58.0, status="changed", note=NOT_JUDGED)
    assert told(book.take(jogged, 1, EPOCH, matched=False)) == [(None, True, "info")]
    assert told(book.take(later[0], 2, EPOCH)) == [(None, False, "info")]
    assert book.take(unjudged, 3, EPOCH) == []
    assert told(book.take(later[1], 4, EPOCH)) == [(3, False, "error")]


def test_an_early_alarm_goes_where_the_whole_cycle_is_another_task(book):
    book.take_early(cycle(fault(3), end=3.0), EPOCH)
    whole = book.take(replace(CALM, status="new_task"), 1, EPOCH)
    assert told(whole) == [(3, False, "error"), (None, True, "info")]


def test_an_early_fault_that_may_be_one_already_told_raises_nothing(book):
    book.take(cycle(fault(2)), 1, EPOCH)
    assert book.take_early(cycle(fault(3, 0.7, (2,)), end=3.0), EPOCH) == []
    assert told(book.take_early(cycle(fault(3, 0.7, (4,)), end=3.0), EPOCH)) == [(3, True, "warning")]


def test_an_alarm_says_how_late_it_is_because_of_a_slow_meter(book):
    late = replace(book, behind=0.25)
    (alarm,) = late.take(cycle(fault(2)), 1, EPOCH)
    assert alarm.evidence["power_behind_s"] == 0.25
    assert alarm.statement == "Joint 2 turns harder. The power meter delays this alarm by 0.25 s."
    (alarm,) = book.take(cycle(fault(2)), 1, EPOCH)
    assert "power_behind_s" not in alarm.evidence
    assert alarm.statement == "Joint 2 turns harder."
