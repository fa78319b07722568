"""Recognition of held poses, on motions whose rests are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_plugins.models.static.held import HeldPose, Recogniser

STEP = 20_000_000


def motion(*parts: tuple[tuple[float, float], float]) -> np.ndarray:
    """Angles (N, 2) at 50 Hz: each part goes to a pose in 0.5 s and rests there for so many seconds."""
    out = [np.zeros((1, 2))]
    for pose, rest in parts:
        way = np.linspace(0, 1, 26)[1:, None]
        out.append(out[-1][-1] + way * (np.array(pose) - out[-1][-1]))
        out.append(np.repeat(out[-1][-1:], round(rest * 50), axis=0))
    return np.concatenate(out)


def run(q: np.ndarray, torque: np.ndarray | None = None, cuts: list[int] | None = None) -> list[HeldPose]:
    time = STEP * np.arange(len(q))
    torque = np.cumsum(np.ones_like(q), axis=0) if torque is None else torque
    recogniser = Recogniser(2)
    edges = [0, *sorted(cuts or []), len(q)]
    return [pose for a, b in pairwise(edges) for pose in recogniser.update(time[a:b], q[a:b], torque[a:b])]


def test_each_rest_is_given_once_with_mean_spread_and_count():
    q = motion(((1.0, -1.0), 4.0), ((0.5, 0.5), 3.0))
    first, second = run(q)
    np.testing.assert_allclose(first.q, [1.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(second.q, [0.5, 0.5], atol=1e-12)
    assert first.count == second.count == 101
    # At rest from row 25 on, the torque counts from 0.5 s later: rows 50 to 150, whose "torque" is the row number + 1.
    assert first.start == 50 * STEP
    np.testing.assert_allclose(first.torque, 101.0)
    np.testing.assert_allclose(first.spread, np.std(np.arange(101), ddof=1))


def test_the_way_to_a_pose_counts_from_where_each_joint_last_turned():
    q = motion(((1.0, -1.0), 3.0), ((1.5, -0.5), 3.0), ((0.25, -0.5), 3.0))
    ways = [pose.approach for pose in run(q)]
    np.testing.assert_allclose(ways[0], [1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(ways[1], [1.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(ways[2], [-1.25, 0.5], atol=1e-9)


def test_a_hole_in_the_samples_begins_the_rest_anew_and_gives_the_pose_once():
    q = motion(((1.0, 1.0), 9.0))
    time = STEP * np.arange(len(q))
    recogniser = Recogniser(2)
    keep = (time < 2 * 10**9) | (time > 3 * 10**9)
    found = recogniser.update(time[keep], q[keep], q[keep])
    assert len(found) == 1
    assert found[0].start >= 3.5 * 10**9
    later = time > 7 * 10**9
    assert recogniser.update(time[later] + 10**9, q[later], q[later]) == []


@given(cuts=st.lists(st.integers(0, 500), max_size=8))
@settings(max_examples=12, deadline=None)
def test_blocks_may_be_cut_anywhere(cuts):
    q = motion(((1.0, -1.0), 3.0), ((0.5, 0.5), 3.0))
    whole, pieces = run(q), run(q, cuts=[min(cut, len(q)) for cut in cuts])
    assert [(p.start, p.end, p.count) for p in whole] == [(p.start, p.end, p.count) for p in pieces]
    for a, b in zip(whole, pieces, strict=True):
        np.testing.assert_array_equal(a.approach, b.approach)
