"""The share of healthy intervals in which a false alarm is accepted."""

from dataclasses import replace

from tests.plugins.faults.cycles.conftest import judged
from tests.plugins.faults.cycles.four_joints import Cycle, Fault, run


def test_a_weak_fault_is_told_only_where_more_false_alarms_are_accepted(known):
    measured = run([Cycle("B"), Cycle("A", faults=(Fault("friction", 1, 0.13),)), Cycle("B")], seed=33)
    strict, lenient = (judged(replace(known, false_alarms=share), measured)[1].faults for share in (1e-12, 0.1))
    assert [f.joint for f in lenient] == [2]
    assert strict == ()
