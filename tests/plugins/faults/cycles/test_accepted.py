"""The share of healthy intervals in which a false alarm is accepted."""

from dataclasses import replace

import pytest

from cellwatt_plugins.faults.cycles.explain import FAULT_ODDS, USUAL_RATE, odds_of, temper_of
from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.recording import Recording
from tests.plugins.faults.cycles.arm_of_points import Cycle, Fault, run


def test_ten_times_fewer_false_alarms_take_ten_times_the_evidence():
    assert odds_of(USUAL_RATE) == pytest.approx(FAULT_ODDS)
    assert odds_of(1e-3) - odds_of(1e-2) == pytest.approx(2.302585)


def test_what_nothing_explains_weakens_all_evidence():
    assert temper_of(0.8) == temper_of(1.0) == 1.0
    assert temper_of(3.0) > temper_of(1.5) > 1.0


def test_a_weak_fault_is_told_only_where_more_false_alarms_are_accepted(known):
    measured = run([Cycle("B"), Cycle("A", faults=(Fault("friction", 1, 0.13),)), Cycle("B")], seed=33)
    recording = Recording(measured.time, measured.position, measured.power)
    strict, lenient = (
        judge_recording(recording, replace(known, false_alarms=share))[1].faults for share in (1e-12, 0.1)
    )
    assert [f.joint for f in lenient] == [2]
    assert strict == ()
