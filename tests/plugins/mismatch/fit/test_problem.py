"""What samples count for."""

import numpy as np

from cellwatt_plugins.mismatch.fit.problem import rattling
from cellwatt_plugins.mismatch.fit.rows import Filtered


def test_a_joint_that_rattles_counts_for_little_while_it_does():
    time = np.arange(2000) / 125
    slow, burst = np.sin(2 * np.pi * 0.5 * time), np.where((time > 8) & (time < 11), 1.0, 0.0)
    target = np.column_stack([slow, slow + 20 * burst * np.sin(2 * np.pi * 16 * time)])
    variance = rattling(target, Filtered(len(time), 5, 1 / 125, 8.0), np.ones(2))
    assert not variance[:, 0].any()
    assert not variance[(time < 7) | (time > 12), 1].any()
    assert np.all(np.sqrt(variance[(time > 8.5) & (time < 10.5), 1]) > 1.0)
