"""Plans of poses: the sequence, safety and order."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from cellwatt.errors import ConfigError
from cellwatt_plugins.models.static.command import plan_poses as command
from cellwatt_plugins.models.static.plan import STAGE, halton, plan_poses, travel, within
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import Checker
from tests.plugins.models.static import arms

SPEED = np.radians([220, 200, 220, 410, 410, 610])


@pytest.fixture(scope="module")
def mh12():
    return Arm.load("mh12")


def test_the_sequence_is_haltons():
    np.testing.assert_allclose(halton(8, 2)[:, 0], [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8, 7 / 8, 1 / 16])
    np.testing.assert_allclose(halton(5, 2)[:, 1], [1 / 3, 2 / 3, 1 / 9, 4 / 9, 7 / 9])
    np.testing.assert_allclose(halton(200, 6), arms.halton(200), atol=1e-12)


def test_the_packaged_robot_has_the_limits_of_the_paper(mh12):
    """Its URDF is held against the maker's figures in tests/science/test_packaged_robots.py."""
    np.testing.assert_allclose(mh12.limits, arms.LIMITS)


def test_all_of_the_papers_poses_are_safe(mh12):
    plan = plan_poses(532, arms.LIMITS, SPEED, Checker(mh12, arms.LIMITS))
    assert (len(plan.q), plan.unsafe, plan.unreachable) == (532, 0, 0)
    expected = within(arms.LIMITS, halton(532, 6))
    np.testing.assert_allclose(sorted(map(tuple, plan.q)), sorted(map(tuple, expected)))
    assert plan.travel < 0.5 * travel(expected, SPEED)
    assert (np.abs(np.mean(np.diff(plan.q, axis=0) > 0, axis=0) - 0.5) < 0.1).all()  # both sides of approach


def test_wide_limits_leave_unsafe_places_out(mh12):
    limits = np.array(arms.LIMITS)
    limits[1], limits[2] = (-1.5, 1.9), (-1.4, 2.5)
    checker = Checker(mh12, limits)
    plan = plan_poses(60, limits, SPEED, checker)
    assert plan.unsafe > 0
    assert len(plan.q) + plan.unreachable == 60
    assert checker.safe(plan.q).all()
    assert all(checker.safe_move(a, b) for a, b in zip(plan.q[:-1], plan.q[1:], strict=True))


def test_the_command_writes_the_plan(tmp_path):
    done = CliRunner().invoke(command, ["--count", "12", "--out", str(tmp_path / "plan"), "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.output)
    assert (report["robot"], report["poses"]) == ("mh12", 12)
    table = np.genfromtxt(report["file"], delimiter=",", names=True)
    assert table["pose"].tolist() == list(range(12))
    angles = np.stack([table[f"q_{i}"] for i in range(1, 7)], axis=1)
    np.testing.assert_allclose(
        sorted(map(tuple, angles)), sorted(map(tuple, within(arms.LIMITS, halton(12, 6)))), atol=1e-6
    )
    assert report["duration_s"] == pytest.approx(4 * report["travel_s"] + 12 * 3.4)


class Hemmed:
    """Every pose is safe, but no path begins or ends within ``reach`` rad of the middle of joint 1."""

    def __init__(self, reach: float) -> None:
        self.reach = reach

    def safe(self, q):
        return np.ones(len(q), dtype=bool)

    def safe_move(self, start, end):
        return min(abs(start[0]), abs(end[0])) > self.reach


def test_a_first_pose_that_is_hemmed_in_is_left_out():
    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    assert plan_poses(40, limits, np.ones(2), Hemmed(-1.0)).q[0, 0] == 0.0
    plan = plan_poses(40, limits, np.ones(2), Hemmed(1e-9))
    assert (len(plan.q), plan.unreachable) == (39, 1)
    assert plan.q[:, 0].all()


def test_no_safe_path_at_all_is_an_error():
    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    with pytest.raises(ConfigError, match="no straight path between two of 5 safe poses is safe"):
        plan_poses(5, limits, np.ones(2), Hemmed(2.0))


def test_the_first_poses_of_a_plan_are_those_of_a_short_plan(mh12):
    checker = Checker(mh12, arms.LIMITS)
    long, short = (plan_poses(n, arms.LIMITS, SPEED, checker).q for n in (160, STAGE))
    np.testing.assert_array_equal(long[:STAGE], short)
