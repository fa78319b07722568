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
from tests.plugins.models.static.test_held import motion


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return load_robot(arms.write_robot(tmp_path_factory.mktemp("robot"), arms.Arm()))


def samples(count):
    return arms.samples(arms.Arm(), np.random.default_rng(1), count)


def save(folder, columns, name="samples.parquet"):
    path = folder / name
    pq.write_table(pa.table(columns), path)
    return path


def test_samples_become_means_in_newton_metres(tmp_path, robot):
    table = samples(15)
    poses = read_poses([save(tmp_path, table)], robot)
    assert len(poses) == 15
    np.testing.assert_allclose(poses.torque, arms.Arm().load(poses.q), atol=0.006 * arms.RATED.max())
    percent = table["torque_percent_2"].reshape(15, 100)
    np.testing.assert_allclose(poses.torque[:, 1], 4.6 * percent.mean(axis=1))


def test_poses_of_drives_that_were_off_are_left_out(tmp_path, robot):
    table = samples(20)
    off = (table["pose"] == 3) | (table["pose"] == 9)
    for j in range(6):
        noise = np.random.default_rng(j).normal(0, 0.1, off.sum())
        table[f"torque_percent_{j + 1}"] = table[f"torque_percent_{j + 1}"].copy()
        table[f"torque_percent_{j + 1}"][off] = noise
    poses = read_poses([save(tmp_path, table)], robot)
    assert len(poses) == 18
    assert poses.notes == ("2 poses without torque at any joint are left out: the drives were off",)


@pytest.mark.parametrize("rows", [1, 100])
def test_a_joint_is_held_from_the_side_of_its_last_movement(tmp_path, robot, rows):
    table = {name: values.reshape(-1, 100)[:15, :rows].ravel() for name, values in samples(20).items()}
    for j in range(6):
        table[f"q_{j + 1}"] = np.where(table["pose"] % 2 == j % 2, table[f"q_{j + 1}"], np.nan)
    angles = np.column_stack([table[f"q_{j + 1}"] for j in range(6)])
    for i in range(rows, len(angles)):  # half of the joints stay, but for noise
        angles[i] = np.where(np.isnan(angles[i]), angles[i - rows] + 1e-6 * (-1) ** i, angles[i])
    angles[np.isnan(angles)] = 0.0
    poses = read_poses([save(tmp_path, table | {f"q_{j + 1}": angles[:, j] for j in range(6)})], robot)
    moved = np.diff(poses.q, axis=0)
    assert np.isnan(poses.approach[0]).all()
    still = np.abs(moved) < 1e-4
    side = np.sign(poses.approach)
    np.testing.assert_array_equal(side[1:][~still], np.sign(moved[~still]))
    np.testing.assert_array_equal(side[2:][still[1:]], side[1:-1][still[1:]])


def test_poses_are_recognised_in_a_recording_of_motion(tmp_path, robot):
    goals = np.random.default_rng(3).uniform(-1, 1, (14, 6))
    q = motion(*((goal, 2.8) for goal in goals))
    torque = arms.Arm().load(q) / arms.RATED
    columns = {"t": 0.02 * np.arange(len(q))}
    for j in range(6):
        columns |= {f"arm.joint_{j + 1}.position": q[:, j], f"arm.joint_{j + 1}.torque_ratio": torque[:, j]}
    columns["payload"] = np.where(columns["t"] < 30, 0.0, 5.0)
    poses = read_poses([save(tmp_path, columns)], robot)
    np.testing.assert_allclose(poses.q, goals, atol=1e-9)
    np.testing.assert_allclose(poses.torque, arms.Arm().load(goals), rtol=1e-9, atol=1e-9)
    assert np.unique(poses.payload).tolist() == [0.0, 5.0]
    np.testing.assert_array_equal(np.sign(poses.approach[1:]), np.sign(np.diff(goals, axis=0)))


def test_samples_that_are_no_numbers_are_left_out_and_counted(tmp_path, robot):
    table = samples(15)
    table["torque_percent_2"] = table["torque_percent_2"].astype(float)
    table["torque_percent_2"][[250, 260]] = np.nan
    poses = read_poses([save(tmp_path, table)], robot)
    assert len(poses) == 15
    assert np.isfinite(poses.torque).all()
    (note,) = poses.notes
    assert "2 of 1500 rows have positions or torques that are not numbers" in note


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda t: t.pop("torque_percent_5"), r"no column torque_percent_5; there are torque_percent_1"),
        (lambda t: t.update({k: v[:500] for k, v in t.items()}), "5 poses; a training needs 12, and 40"),
        (lambda t: (t.pop("pose"), t.pop("t")), r"expected a column pose, or t \(s\)"),
        (lambda t: t.update(pose=np.char.add("P", t["pose"].astype(str))), "column pose holds text"),
        (lambda t: t.update(torque_percent_2=np.full(2000, np.nan)), "there are none of joint_2"),
        (lambda t: (t.pop("pose"), t.update(q_1=np.arange(2000))), "no pose was held long enough"),
        (lambda t: t.update({k: 0 * v for k, v in t.items() if "torque" in k}), "all torques are 0"),
        (lambda t: t.update({k: 0 * v for k, v in t.items() if k.startswith("q_")}), "all poses are the same"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, robot, change, text):
    table = samples(20)
    change(table)
    with pytest.raises(RecordingError, match=text):
        read_poses([save(tmp_path, table)], robot)


def test_recordings_of_one_pose_each_do_not_show_the_side_of_approach(tmp_path, robot):
    table = samples(13)
    parts = [{name: values[table["pose"] == i] for name, values in table.items()} for i in range(13)]
    with pytest.raises(RecordingError, match="the side of approach is known in 0 of 13 poses"):
        read_poses([save(tmp_path, part, f"{i}.parquet") for i, part in enumerate(parts)], robot)


def test_per_cent_need_rated_torques(tmp_path, robot):
    joints = tuple(joint.model_copy(update={"rated_torque": 0.0}) for joint in robot.joints)
    table = samples(20)
    with pytest.raises(ConfigError, match=r"its torque_ratio needs the rated_torque of joint_1"):
        read_poses([save(tmp_path, table)], robot.model_copy(update={"joints": joints}))
