"""Plans of poses: the sequence, safety, order, and the operator's job."""

from __future__ import annotations

import re
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cellwatt_drivers.yaskawa.polls import motor_angles
from cellwatt_plugins.models.static.command import plan_poses as command
from cellwatt_plugins.models.static.plan import STAGE, halton, plan_poses, within
from cellwatt_plugins.models.static.planning import LONGEST, jobs
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
    assert plan.travel < 0.5 * plan.unordered
    assert (np.abs(plan.rising - 0.5) < 0.1).all()


def test_wide_limits_leave_unsafe_places_out(mh12):
    limits = np.array(arms.LIMITS)
    limits[1], limits[2] = (-1.5, 1.9), (-1.4, 2.5)
    checker = Checker(mh12, limits)
    plan = plan_poses(60, limits, SPEED, checker)
    assert plan.unsafe > 0
    assert len(plan.q) + plan.unreachable == 60
    assert checker.safe(plan.q).all()
    assert all(checker.safe_move(a, b) for a, b in zip(plan.q[:-1], plan.q[1:], strict=True))


def read_job(text: str) -> tuple[list[list[int]], list[str]]:
    lines = text.split("\r\n")
    places = [list(map(int, line.split("=")[1].split(","))) for line in lines if re.match(r"C\d{5}=", line)]
    return places, lines[lines.index("NOP") + 1 : lines.index("END")]


def test_the_job_goes_to_each_pose_once_and_waits():
    per_degree, zero = np.array([1341.4, 1341.4, 1341.4, 1000, 1000, -622]), np.array([0, -1.5, 0, 0, 0.1, 0])
    coupling = np.eye(6)
    coupling[5, 4] = -0.1
    q = within(arms.LIMITS, halton(10, 6))
    encoders = SimpleNamespace(pulses_per_degree=per_degree, coupling=coupling, zero=zero)
    written = jobs("HELD", q, encoders, 25.0, 3.0, datetime(2026, 5, 4, 10, 0))
    ((name, text),) = written.items()
    assert name == "HELD.JBI"
    assert text.startswith("/JOB\r\n//NAME HELD\r\n//POS\r\n///NPOS 10,0,0,0,0,0\r\n")
    places, steps = read_job(text)
    driver = motor_angles(per_degree, coupling, zero)
    np.testing.assert_allclose([driver(place) for place in places], q, atol=3e-5)
    assert steps == [s for i in range(10) for s in (f"MOVJ C{i:05d} VJ=25.00 PL=0", "TIMER T=3.00")]


def test_a_long_plan_is_several_jobs():
    q = within(arms.LIMITS, halton(2 * LONGEST + 1, 6))
    encoders = SimpleNamespace(pulses_per_degree=np.full(6, 1000.0))
    written = jobs("HELD", q, encoders, 25.0, 3.0, datetime(2026, 5, 4))
    assert list(written) == ["HELD-1.JBI", "HELD-2.JBI", "HELD-3.JBI"]
    assert sum(len(read_job(text)[0]) for text in written.values()) == len(q)


def test_the_command_writes_plan_and_job(tmp_path):
    cell = tmp_path / "cell.yaml"
    source = {"driver": "yaskawa", "host": "127.0.0.1", "pulses_per_degree": [1000.0] * 6}
    cell.write_text(yaml.safe_dump({"site": "a", "cell": "b", "sources": {"arm": source}}))
    done = CliRunner().invoke(command, ["--count", "12", "--out", str(tmp_path / "plan"), "--cell", str(cell)])
    assert done.exit_code == 0, done.output
    assert "12 poses of mh12" in done.output
    table = np.genfromtxt(tmp_path / "plan" / "plan.csv", delimiter=",", names=True)
    places, _ = read_job((tmp_path / "plan" / "POSES.JBI").read_bytes().decode())
    angles = np.stack([table[f"q_{i}"] for i in range(1, 7)], axis=1)
    np.testing.assert_allclose(np.radians(np.array(places) / 1000), angles, atol=1e-5)


def test_the_first_poses_of_a_plan_are_those_of_a_short_plan(mh12):
    checker = Checker(mh12, arms.LIMITS)
    long, short = (plan_poses(n, arms.LIMITS, SPEED, checker).q for n in (160, STAGE))
    np.testing.assert_array_equal(long[:STAGE], short)
