"""A recording that is cut stretch by stretch gives what a stage gives block by block."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.segment.intervals import Segmenter
from cellwatt_plugins.segment.motion import Thresholds
from cellwatt_plugins.segment.stage import Cutting, intervals_of

STEP = 10_000_000
CUTTING = Cutting("arm", 2, STEP, Thresholds())


def frames(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times ns and noisy positions of two joints that move now and then."""
    time = STEP * np.arange(round(seconds * 100))
    t = time * 1e-9
    position = np.column_stack([np.sin(t) * (t % 7 < 4), 0.5 * np.cos(2 * t) * (t % 5 < 2)])
    return time, position + np.random.default_rng(seed).normal(0.0, 2e-4, position.shape)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_stretches_between_holes_give_the_intervals_of_all_frames(seed):
    time, position = frames(60.0, seed)
    random = np.random.default_rng(seed)
    for first in random.integers(0, len(time), 9):
        position[first : first + random.integers(1, 60)] = np.nan
    kept = np.ones(len(time), bool)
    for first in random.integers(0, len(time), 6):
        kept[first : first + random.integers(1, 400)] = False
    time, position = time[kept], position[kept]
    whole = Segmenter("arm", 2, STEP)
    expected = []
    for at in range(0, len(time), 97):
        expected += whole.update(time[at : at + 97], position[at : at + 97])
    expected += whole.finish()
    assert len({interval.number for interval in expected}) > 10
    assert intervals_of(CUTTING, time, position) == expected


def test_no_frames_give_no_intervals():
    time, position = frames(1.0, 0)
    assert intervals_of(CUTTING, time, np.full_like(position, np.nan)) == []
