from dataclasses import replace

import numpy as np
import pytest
from faults.cases import Plan, Truth, draw_plans
from faults.plant import Fault
from faults.scoring import count
from faults.tasks import Task

from cellwatt_plugins.faults.cycles.findings import CycleFinding, FaultFinding

ENDS = (1.0, 2.0, 3.0, 4.0)
CUT = Fault("drive_cut", 2, 1.0, 0.5)
STUCK = Fault("encoder_stuck", 0, 1.0, 0.5)


def truth(*faults, watts=20.0, acts=1):
    n = len(faults)
    return Truth(Plan(0, 1.0, faults), 0.0, 5.0, (watts,) * n, len(ENDS), (acts,) * n, ENDS)


def told(joint, kind, **more):
    return FaultFinding(joint, kind, (1, 2), 12.0, 0.99, (), "", **more)


def cycle(*faults, end=4.0):
    return CycleFinding(0.1, end, "task_1", 1.0, "fault" if faults else "healthy", "", faults)


def test_a_right_name_is_isolated_and_dated_by_when_it_was_first_told():
    found = count([truth(CUT)], [cycle(told(3, "joint"))], [cycle(told(3, "joint"), end=2.0)])
    assert (found.clear_faults, found.isolated, found.wrong_names) == (1, 1, 0)
    assert (found.in_first_interval, found.by_next_interval) == (0, 1)
    at_once = count([truth(CUT)], [cycle(told(3, "joint"))], [cycle(told(3, "joint"), end=1.0)])
    assert at_once.in_first_interval == 1


def test_a_kind_that_cannot_be_told_is_neither_isolated_nor_wrong():
    for kind, other in (("encoder", "joint"), ("joint", "encoder")):
        found = count([truth(CUT)], [cycle(told(3, kind, or_kind=other))], [])
        assert (found.isolated, found.undecided, found.wrong_names) == (0, 1, 0)


def test_it_is_wrong_where_the_joint_is_not_faulty_at_all():
    found = count([truth(CUT)], [cycle(told(3, "joint"), told(5, "encoder", or_kind="joint"))], [])
    assert (found.isolated, found.undecided, found.wrong_names) == (1, 0, 1)
    calm = count([replace(truth(), plan=Plan(0, 1.0))], [cycle(told(5, "encoder", or_kind="joint"))], [])
    assert (calm.false_alarms, calm.false_intervals) == (1, 2)


def test_a_wrong_name_is_wrong():
    found = count([truth(STUCK)], [cycle(told(2, "joint"))], [])
    assert (found.clear_faults, found.isolated, found.wrong_names) == (1, 0, 1)


@pytest.mark.parametrize("calm", [True, False])
def test_calm_plans_hold_no_fault(calm):
    poses = np.array([[0.0] * 6, [1.0] * 6, [0.0] * 6])
    task = Task(poses, np.ones(2), np.ones(2), "jerk", None)
    plans = draw_plans(np.random.default_rng(0), 6, [task] * 3, 40, calm)
    assert any(plan.faults for plan in plans) is not calm
    assert any(plan.harmless for plan in plans)
