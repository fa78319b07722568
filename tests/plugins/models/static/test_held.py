"""Recognition of held poses, on motions whose rests are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.models.static.held import held, turned

STEP = 20_000_000


def motion(*parts: tuple[Sequence[float], float]) -> np.ndarray:
    """Angles (N, joints) at 50 Hz: each part goes to a pose in 0.5 s and rests there for so many seconds."""
    out = [np.zeros((1, len(parts[0][0])))]
    for pose, rest in parts:
        way = np.linspace(0, 1, 26)[1:, None]
        out.append(out[-1][-1] + way * (np.array(pose) - out[-1][-1]))
        out.append(np.repeat(out[-1][-1:], round(rest * 50), axis=0))
    return np.concatenate(out)


def test_each_rest_is_given_once():
    q = motion(((1.0, -1.0), 4.0), ((0.5, 0.5), 3.0))
    # At rest from row 25 on, the torque counts from 0.5 s later: rows 50 to 150.
    first, second = held(STEP * np.arange(len(q)), q)
    assert (first, second.stop - second.start) == (slice(50, 151), 101)
    np.testing.assert_allclose(q[second], np.full((101, 2), 0.5), atol=1e-12)


def test_the_way_to_a_pose_counts_from_where_each_joint_last_turned():
    q = motion(((1.0, -1.0), 3.0), ((1.5, -0.5), 3.0), ((0.25, -0.5), 3.0))
    last = [part.stop - 1 for part in held(STEP * np.arange(len(q)), q)]
    np.testing.assert_allclose((q - turned(q))[last], [[1.0, -1.0], [1.5, 0.5], [-1.25, 0.5]], atol=1e-9)
    assert np.isnan(turned(q)[0]).all()


def test_a_hole_in_the_samples_begins_the_rest_anew_and_gives_the_pose_once():
    q = motion(((1.0, 1.0), 9.0))
    time = STEP * np.arange(len(q))
    keep = (time < 2 * 10**9) | (time > 3 * 10**9)
    time = time[keep]
    time[time > 7 * 10**9] += 10**9
    (found,) = held(time, q[keep])
    assert time[found.start] >= 3.5 * 10**9
