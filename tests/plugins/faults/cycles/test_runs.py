import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.runs import find_runs
from tests.plugins.faults.cycles.conftest import recorded
from tests.plugins.faults.cycles.four_joints import HOME_A, TASK_A, Cycle, run


def test_every_move_is_a_run_between_its_poses():
    found = find_runs(recorded(run([Cycle("A"), Cycle("A", 0.6)], seed=2)))
    poses = [HOME_A]
    for by in TASK_A * 2:
        poses.append(poses[-1] + [by.get(j, 0.0) for j in range(4)])
    assert len(found) == 10
    assert np.allclose([r.before for r in found], poses[:-1], atol=2e-3)
    assert np.allclose([r.after for r in found], poses[1:], atol=2e-3)


def test_an_encoder_that_jumps_is_no_motion():
    measured = run([Cycle("A")], seed=3)
    measured.position[10:, 2] += 0.4
    measured.position[-15:, 2] -= 0.4
    found = find_runs(recorded(measured))
    assert len(found) == 5
    assert found[0].before[2] == pytest.approx(HOME_A[2] + 0.4, abs=1e-3)
