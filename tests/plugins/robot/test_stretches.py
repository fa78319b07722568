import tracemalloc

import numpy as np

from cellwatt_plugins.robot.stretches import at_one_pose, stretches


def test_stretches_end_one_past_their_last() -> None:
    assert stretches(np.array([True, True, False, True, False])) == [(0, 2), (3, 4)]
    assert stretches(np.ones(3, bool)) == [(0, 3)]
    assert stretches(np.zeros(3, bool)) == []


def test_rests_of_a_whole_day_take_little_memory() -> None:
    position = np.repeat([[0.0, 1.0], [0.5, 1.0], [0.0, 1.0]], [1000, 500, 1], axis=0)
    rests = [(k, k + 1) for k in range(len(position))]
    tracemalloc.start()
    found = at_one_pose(position, rests, 0.1, [1.0] * len(rests))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == [*rests[:1000], rests[-1]]
    assert peak < 5e6
