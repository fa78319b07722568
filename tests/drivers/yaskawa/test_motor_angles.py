from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.yaskawa.polls import motor_angles


def test_coupling_comes_before_zero():
    # The third motor carries the second along: q3 = m3 - m2, and reads 0.1 rad more than the pendant.
    angles = motor_angles((180.0, 180.0), ((1.0, 0.0), (-1.0, 1.0)), (0.0, 0.1))
    assert angles((90 * 180, 30 * 180)) == pytest.approx([math.pi / 2, math.pi / 6 - math.pi / 2 + 0.1])


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=3, max_size=3))
def test_without_coupling_each_joint_goes_by_itself(pulses):
    scale = (1341.4, -1000.0, 622.0)
    found = motor_angles(scale)(pulses)
    assert found == pytest.approx([p / k * math.pi / 180 for p, k in zip(pulses, scale, strict=True)])
