import math

import numpy as np
import pytest

from cellwatt_plugins.faults.criteria import Tolerance, sustained


def test_tolerance_is_relative_with_a_floor():
    watts = Tolerance(power=0.1, floor=5.0).watts(np.array([0.0, 30.0, 50.0, 200.0, -120.0]))
    assert watts == pytest.approx([5.0, 5.0, 5.0, 20.0, 12.0])
    assert Tolerance().position == pytest.approx(math.radians(1))


@pytest.mark.parametrize(
    ("given_codes", "frames", "expected"),
    [
        ([0, 1, 1, 0, 1], 3, 0),
        ([0, 1, 1, 1, 0], 3, 1),
        ([-1, -1, -1, 1, 1, 1], 3, -1),
        ([1, -1, 1, -1], 2, 0),
    ],
)
def test_one_frame_alone_proves_nothing(given_codes, frames, expected):
    assert sustained(np.array(given_codes, dtype=np.int8), frames) == expected
