import numpy as np

from cellwatt_plugins.robot.stretches import stretches


def test_stretches_end_one_past_their_last() -> None:
    assert stretches(np.array([True, True, False, True, False])) == [(0, 2), (3, 4)]
    assert stretches(np.ones(3, bool)) == [(0, 3)]
    assert stretches(np.zeros(3, bool)) == []
