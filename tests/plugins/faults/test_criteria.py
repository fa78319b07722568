import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_plugins.faults.criteria import Tolerance, longest, outside, sustained

codes = st.lists(st.sampled_from([-1, 0, 1]), max_size=40).map(lambda c: np.array(c, dtype=np.int8))


def test_tolerance_is_relative_with_a_floor():
    watts = Tolerance(power=0.1, floor=5.0).watts(np.array([0.0, 30.0, 50.0, 200.0, -120.0]))
    assert watts == pytest.approx([5.0, 5.0, 5.0, 20.0, 12.0])
    assert Tolerance().position == pytest.approx(math.radians(1))


def test_outside_is_the_signed_distance_to_a_band():
    assert outside(np.array([1.0, 2.0, 3.5, np.nan]), np.full(4, 1.5), np.full(4, 3.0))[:3] == pytest.approx(
        [-0.5, 0, 0.5]
    )


@pytest.mark.parametrize(
    ("given_codes", "frames", "expected"),
    [
        ([0, 1, 1, 0, 1], 3, 0),
        ([0, 1, 1, 1, 0], 3, 1),
        ([-1, -1, 1, 1, 1], 3, 1),
        ([-1, -1, -1, 1, 1, 1], 3, -1),
        ([1, -1, 1, -1], 2, 0),
        ([], 2, 0),
    ],
)
def test_one_frame_alone_proves_nothing(given_codes, frames, expected):
    assert sustained(np.array(given_codes, dtype=np.int8), frames) == expected


@given(codes, st.integers(1, 8))
def test_sustained_and_longest_agree(given_codes, frames):
    assert bool(sustained(given_codes, frames)) == (longest(given_codes) >= frames)
