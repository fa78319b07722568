from dataclasses import replace

import numpy as np
import pytest
from faults.bound import THRESHOLD
from faults.cases import Plan, Truth, draw_plans
from faults.plant import Fault
from faults.scoring import count
from faults.tasks import Task

from cellwatt_plugins.faults.cycles.findings import CycleFinding, FaultFinding

ENDS = (1.0, 2.0, 3.0, 4.0)
CUT = Fault("drive_cut", 2, 1.0, 0.5)
STUCK = Fault("encoder_stuck", 0, 1.0, 0.5)


def truth(*faults, ratio=30.0):
    n = len(faults)
    ratios = (ratio,) * n, (ratio / 2,) * n
    return Truth(Plan(0, 1.0, faults), 0.0, 5.0, (20.0,) * n, len(ENDS), (1,) * n, ENDS, *ratios)


def told(joint, kind, **more):
    return FaultFinding(joint, kind, (1, 2), 12.0, 0.99, (), "", **more)


def cycle(*faults, end=4.0):
    return CycleFinding(0.1, end, "task_1", 1.0, "fault" if faults else "healthy", "", faults)


@pytest.mark.parametrize(
    ("early", "end", "detected", "alone", "wrong_joints", "wrong_kinds"),
    [
        pytest.param(told(3, "joint"), 1.0, 1, 1, 0, 0, id="right at once"),
        pytest.param(told(3, "joint"), 2.0, 0, 0, 0, 0, id="right an interval late"),
        pytest.param(replace(told(4, "joint"), alternatives=(3,)), 1.0, 1, 0, 0, 0, id="joint left open"),
        pytest.param(told(3, "joint", or_kind="encoder"), 1.0, 1, 0, 0, 0, id="kind left open"),
        pytest.param(told(3, "encoder"), 1.0, 1, 0, 0, 1, id="wrong kind"),
        pytest.param(told(4, "joint"), 1.0, 0, 0, 1, 0, id="wrong joint"),
    ],
)
def test_what_was_told_while_a_cycle_ran_that_is_named_rightly(early, end, detected, alone, wrong_joints, wrong_kinds):
    found = count([truth(CUT)], [cycle(told(3, "joint"))], [cycle(early, end=end)])
    assert (found.clear_faults, found.isolated, found.wrong_names) == (1, 1, 0)
    assert (found.in_first_interval, found.named_alone_in_first_interval) == (detected, alone)
    assert found.by_next_interval == int(early.joint == 3 or 3 in early.alternatives)
    assert (found.wrong_names_while_running, found.wrong_kinds_while_running) == (wrong_joints, wrong_kinds)


@pytest.mark.parametrize("ratio, best, beyond", [(np.inf, 1.0, 0), (THRESHOLD, 0.5, 0), (0.0, 1e-4, 1)])
def test_what_the_best_detector_would_tell(ratio, best, beyond):
    found = count([truth(CUT, ratio=ratio)], [], [])
    assert found.told_at_best == pytest.approx(best)
    assert (found.out_of_reach, found.out_of_spread) == (beyond, ratio < np.inf)


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


def test_that_it_cannot_tell_is_no_name():
    cannot = FaultFinding(0, "joint", (1, 2), 12.0, 0.97, (3, 5), "")
    found = count([truth(CUT)], [cycle(cannot)], None)
    assert (found.isolated, found.wrong_names, found.cannot_tell) == (0, 0, 1)
    calm = count([replace(truth(), plan=Plan(0, 1.0))], [cycle(cannot)], None)
    assert (calm.false_alarms, calm.false_intervals) == (1, 2)
