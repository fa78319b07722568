import numpy as np
import pytest

from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.intervals.compare import compare
from cellwatt_plugins.faults.reference import LEAD, TAIL, Pattern, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

STEP = 0.02
LENGTH = 1.0
ONSET = 10_000_000_000


def path(t):
    s = np.clip(t / LENGTH, 0, 1)
    return 0.8 * (10 * s**3 - 15 * s**4 + 6 * s**5)


def watts(t):
    s = np.clip(t / LENGTH, 0, 1)
    return 100 + 300 * s**2 * (1 - s) ** 2 * 16 / 3


def made():
    t = -LEAD + STEP * np.arange(round((LEAD + LENGTH + TAIL) / STEP) + 1)

    def pattern(values):
        return Pattern(-LEAD, STEP, tuple(values.tolist()), (0.0,) * len(t))

    return ReferenceInterval((1,), (0.0, 0.3), (0.8, 0.0), LENGTH, 0.3, 5, pattern(watts(t)), {1: pattern(path(t))})


def trace(late):
    t = STEP * np.arange(round(-0.5 / STEP), round(2.0 / STEP))
    q = np.column_stack([path(t - late), np.full(len(t), 0.3)])
    return Trace(ONSET + np.round(t * 1e9).astype(np.int64), q, watts(t - late))


@pytest.mark.parametrize("late", [-0.14, 0.1])
def test_a_jolt_that_moved_the_onset_is_put_right(late):
    found = compare(made(), ONSET, trace(late), Tolerance(), 0.04)
    assert not found.power_codes.any()
    assert found.follows[4:-4].mean() > 0.9
