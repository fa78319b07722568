"""The segmenter on recordings of real arms that lie beside the checkout, against the controller's own velocities."""

from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.segment.intervals import Segmenter
from cellwatt_plugins.segment.tasks import TaskRecogniser

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
MOVES = 0.0175  # rad/s on the recorded velocity: 1 deg/s
FAST = 0.05  # rad/s

pytestmark = pytest.mark.skipif(not DATA.exists(), reason="no recordings of real arms beside the checkout")


def ur10e(name):
    table = np.genfromtxt(DATA / "ur10e" / name, delimiter=",")[:, :13]
    table = table[~np.isnan(table).any(axis=1)]
    return table[:, 0], table[:, 1:7], table[:, 7:13], 50.0


def ur3e(name):
    wanted = ["timestamp", *(f"actual_{what}_{j}" for what in ("q", "qd") for j in range(6))]
    path = DATA / "ur3e_pick_and_place" / name
    names = path.read_text().partition("\n")[0].split()
    table = np.genfromtxt(path, skip_header=1, usecols=[names.index(each) for each in wanted])
    return table[:, 0], table[:, 1:7], table[:, 7:], 20.0


def cut(t, q, qd, rate):
    """Closed intervals on a grid, and velocities there."""
    rising = np.r_[True, np.diff(t) > 0]
    t, q, qd = t[rising] - t[0], q[rising], qd[rising]
    grid = np.arange(int(t[-1] * rate)) / rate
    on_grid = np.column_stack([np.interp(grid, t, c) for c in q.T])
    speed = np.column_stack([np.interp(grid, t, c) for c in qd.T])
    time = np.round(grid * 1e9).astype(np.int64)
    segmenter = Segmenter("arm", 6, round(1e9 / rate))
    found = [i for i in segmenter.update(time, on_grid) + segmenter.finish() if i.closed]
    mask = np.zeros(speed.shape, dtype=bool)
    for interval in found:
        inside = (time >= interval.start) & (time <= interval.end)
        for joint in interval.moving:
            mask[inside, joint - 1] = True
    return found, mask, speed


@pytest.mark.parametrize("joint", [2, 6])
def test_a_joint_that_swings_is_cut_at_every_turn_and_its_swings_are_one_task(joint):
    found, mask, speed = cut(*ur10e(f"jointwise_motion/ur-20_01_22-joint_{joint}.csv"))
    swings = [i for i in found if i.moving == (joint,) and abs(i.displacement[joint - 1]) > 1.5]
    assert len(swings) >= 10
    assert all(4.9 < (i.end - i.start) * 1e-9 < 5.1 for i in swings[:10])
    assert ((np.abs(speed) > FAST) & ~mask).mean() < 5e-4
    assert (mask.any(axis=1) == (np.abs(speed) > MOVES).any(axis=1)).mean() > 0.96
    recogniser = TaskRecogniser()
    tasks = [t for interval in found for t in recogniser.update(interval)]
    assert [t.name for t in tasks] == ["task_1"] * 5
    assert {t.variant for t in tasks} == {"speed=1.00"}


@pytest.mark.parametrize("pose", [1, 10])
def test_an_arm_that_holds_a_pose_rests(pose):
    found, *_ = cut(*ur10e(f"validation_data/ur-20_01_17-p{pose}.csv"))
    assert [i.moving for i in found] == [()]


def test_moves_from_point_to_point_are_told_apart_though_none_rests_between():
    found, mask, speed = cut(*ur10e("validation_data/ur-20_01_17-ptp_10_points.csv"))
    assert [bool(i.moving) for i in found] == [False, *[True] * 9, False]
    assert not ((np.abs(speed) > FAST) & ~mask).any()
    assert (mask.any(axis=1) == (np.abs(speed) > MOVES).any(axis=1)).mean() > 0.98
    for interval in found[1:-1]:
        middle = speed[round((interval.start + interval.end) / 2 * 50e-9)]
        assert {j + 1 for j in np.flatnonzero(np.abs(middle) > MOVES)} <= set(interval.moving)


@pytest.mark.parametrize("name", ["no_faults", "case1", "case1_no_blocks", "demo_heart", "demo_square"])
def test_pick_and_place(name):
    found, mask, speed = cut(*ur3e(f"robot_output/{name}_robot_output.csv"))
    assert not ((np.abs(speed) > FAST) & ~mask).any()
    assert (mask.any(axis=1) == (np.abs(speed) > MOVES).any(axis=1)).mean() > 0.95
    lifts = [i for i in found if i.moving == (2, 3, 4) and 0.6 < (i.end - i.start) * 1e-9 < 1.2]
    assert len(lifts) >= 0.5 * sum(bool(i.moving) for i in found)
