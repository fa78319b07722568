"""Poses from the tables that a person has."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ConfigError, RecordingError
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.robot import load_robot
from tests.plugins.models.static import arms


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return load_robot(arms.write_robot(tmp_path_factory.mktemp("robot"), arms.Arm()))


def save(folder, columns, name="samples.parquet"):
    path = folder / name
    pq.write_table(pa.table(columns), path)
    return path


def test_samples_become_means_in_newton_metres(tmp_path, robot):
    table = arms.samples(arms.Arm(), np.random.default_rng(1), 15)
    poses = read_poses([save(tmp_path, table)], robot)
    assert len(poses) == 15
    np.testing.assert_allclose(poses.torque, arms.Arm().load(poses.q), atol=0.006 * arms.RATED.max())
    percent = table["torque_percent_2"].reshape(15, 100)
    np.testing.assert_allclose(poses.torque[:, 1], 4.6 * percent.mean(axis=1))
    assert np.isnan(poses.approach[0]).all()
    np.testing.assert_allclose(poses.approach[1:], np.diff(poses.q, axis=0))


def test_poses_are_recognised_in_a_recording_of_motion(tmp_path, robot):
    rng = np.random.default_rng(3)
    goals = rng.uniform(-1, 1, (14, 6))
    q = [np.zeros((1, 6))]
    for goal in goals:
        q.append(q[-1][-1] + np.linspace(0, 1, 26)[1:, None] * (goal - q[-1][-1]))
        q.append(np.repeat(goal[None], 140, axis=0))
    q = np.concatenate(q)
    torque = arms.Arm().load(q) / arms.RATED
    columns = {"t": 0.02 * np.arange(len(q))}
    for j in range(6):
        columns |= {f"arm.joint_{j + 1}.position": q[:, j], f"arm.joint_{j + 1}.torque_ratio": torque[:, j]}
    poses = read_poses([save(tmp_path, columns)], robot)
    np.testing.assert_allclose(poses.q, goals, atol=1e-9)
    np.testing.assert_allclose(poses.torque, arms.Arm().load(goals), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(np.sign(poses.approach[1:]), np.sign(np.diff(goals, axis=0)))


def test_a_recording_without_a_whole_row_is_refused(tmp_path, robot):
    columns = {"t": 0.02 * np.arange(300)}
    for j in range(6):
        columns |= {f"arm.joint_{j + 1}.position": np.zeros(300), f"arm.joint_{j + 1}.torque": np.full(300, np.nan)}
    with pytest.raises(RecordingError, match="no pose was held long enough"):
        read_poses([save(tmp_path, columns)], robot)


def test_poses_with_samples_that_are_no_numbers_are_told(tmp_path, robot):
    table = arms.samples(arms.Arm(), np.random.default_rng(1), 15)
    table["torque_percent_2"] = table["torque_percent_2"].astype(float)
    table["torque_percent_2"][[250, 260]] = np.nan
    poses = read_poses([save(tmp_path, table)], robot)
    assert len(poses) == 14
    assert poses.notes == ("1 poses have samples that are no numbers and are left out",)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda t: t.pop("torque_percent_5"), r"no column torque_percent_5; there are torque_percent_1"),
        (lambda t: t.update({k: v[:500] for k, v in t.items()}), "5 poses; a training needs 12, and 40"),
        (lambda t: (t.pop("pose"), t.pop("t")), r"expected a column pose, or t \(s\)"),
        (lambda t: t.update({k: 0 * v for k, v in t.items() if "torque" in k}), "all torques are 0"),
        (lambda t: t.update({k: 0 * v for k, v in t.items() if k.startswith("q_")}), "all poses are the same"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, robot, change, text):
    table = arms.samples(arms.Arm(), np.random.default_rng(1), 20)
    change(table)
    with pytest.raises(RecordingError, match=text):
        read_poses([save(tmp_path, table)], robot)


def test_per_cent_need_rated_torques(tmp_path, robot):
    joints = tuple(joint.model_copy(update={"rated_torque": 0.0}) for joint in robot.joints)
    table = arms.samples(arms.Arm(), np.random.default_rng(1), 20)
    with pytest.raises(ConfigError, match=r"joint_1 has no rated_torque, which torque_percent_1 of .* needs"):
        read_poses([save(tmp_path, table)], robot.model_copy(update={"joints": joints}))
