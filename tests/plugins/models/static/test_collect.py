"""Collections: kept after each pose, and taken up again."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.errors import ConfigError, RecordingError
from cellwatt_plugins.models.static.collect import Collector, place_of
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.robot import load_robot
from tests.plugins.models.static import arms

STEP = 20_000_000


def layout(torque="torque", unit="Nm", source="arm"):
    channels = [
        FrameChannel(f"{source}.joint_{j}.{quantity}", u, "continuous", "linear")
        for quantity, u in (("position", "rad"), (torque, unit))
        for j in range(1, 7)
    ]
    return Layout(tuple(channels), 50.0)


GOALS = arms.within(arms.LIMITS, arms.halton(14))


def frames(grid=None, goals=GOALS, rated=None) -> Frames:
    """A job that goes through the goals and holds each for 3 s."""
    grid = grid or layout()
    q = [np.full((1, 6), -0.05)]
    for goal in goals:
        q.append(q[-1][-1] + np.linspace(0, 1, 26)[1:, None] * (goal - q[-1][-1]))
        q.append(np.repeat(goal[None], 150, axis=0))
    q = np.concatenate(q)
    torque = arms.Arm().load(q) / (1.0 if rated is None else rated)
    values = np.hstack([q, torque])
    zeros = np.zeros(values.shape, np.int64)
    return Frames(grid, 0, STEP * np.arange(1, len(q) + 1), values, zeros.astype(np.uint8), zeros)


def cut(block: Frames, first: int, last: int) -> Frames:
    part = slice(first, last)
    return Frames(block.layout, first, block.time[part], block.values[part], block.quality[part], block.bound[part])


def test_poses_are_kept_one_by_one_and_progress_is_against_the_plan(tmp_path):
    out = tmp_path / "poses.csv"
    plan = np.vstack([GOALS, [[1.0, 0.2, -0.2, 1.9, 1.1, 3.0]]])
    collector = Collector(layout(), None, out, plan)
    seen = []
    for progress in collector.take(frames()):
        rows = out.read_text().splitlines()
        assert len(rows) == 1 + progress.held  # on disk before it is told
        seen.append((progress.held, progress.planned, progress.total))
    assert seen == [(n, n, 15) for n in range(1, 15)]


def test_the_table_is_what_a_training_reads(tmp_path):
    robot = load_robot(arms.write_robot(tmp_path / "robot", arms.Arm()))
    for grid, rated in ((layout(), None), (layout("torque_ratio", "1"), arms.RATED)):
        out = tmp_path / f"{grid.channels[-1].short}.csv"
        assert len(list(Collector(grid, "arm", out, None).take(frames(grid, rated=rated)))) == 14
        poses = read_poses([out], robot)
        np.testing.assert_allclose(poses.q, GOALS, atol=1e-9)
        np.testing.assert_allclose(poses.torque, arms.Arm().load(GOALS), atol=1e-9)
        np.testing.assert_array_equal(poses.count, 101)
        np.testing.assert_array_equal(np.sign(poses.approach[1:]), np.sign(np.diff(GOALS, axis=0)))
        assert np.isfinite(poses.approach).all()


@pytest.mark.parametrize("stop", [500, 517, 700, 1000])
def test_an_interrupted_collection_goes_on(tmp_path, stop):
    """Stopped in any place, going on from where the last whole pose was."""
    out, whole = tmp_path / "poses.csv", frames()
    first = Collector(layout(), None, out, GOALS)
    kept = 0
    for start in range(0, stop, 10):
        for _ in first.take(cut(whole, start, start + 10)):
            kept = start + 10
            first.file.keep_place({"frame": (7, kept)})
    assert place_of(out) == {"frame": (7, kept)}
    second = Collector(layout(), None, out, GOALS)
    assert second.progress.held == first.progress.held
    for progress in second.take(cut(whole, kept, len(whole))):
        last = progress
    assert (last.held, last.planned) == (14, 14)


def test_a_torn_last_row_is_dropped(tmp_path):
    out = tmp_path / "poses.csv"
    list(Collector(layout(), None, out, None).take(frames()))
    text = out.read_bytes()
    out.write_bytes(text[: -len(text.splitlines()[-1]) // 2])
    again = Collector(layout(), None, out, None)
    assert again.progress.held == 13
    assert len(out.read_text().splitlines()) == 14


def test_what_does_not_belong_together_is_refused(tmp_path):
    out = tmp_path / "poses.csv"
    out.write_text("pose,x\n")
    with pytest.raises(RecordingError, match="has other columns than this collection: pose, x"):
        Collector(layout(), None, out, None)
    with pytest.raises(ConfigError, match="the plan is for 5 joints, the arm has 6"):
        Collector(layout(), None, tmp_path / "other.csv", np.zeros((3, 5)))
    with pytest.raises(ConfigError, match="torque"):
        Collector(Layout(layout().channels[:6], 50.0), None, tmp_path / "other.csv", None)
    collector = Collector(layout(), None, tmp_path / "other.csv", None)
    with pytest.raises(RecordingError, match="channels have changed"):
        list(collector.take(frames(layout(source="other"))))
