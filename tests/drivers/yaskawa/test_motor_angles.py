from __future__ import annotations

import math

import pytest

from cellwatt_drivers.yaskawa.polls import motor_angles


def test_coupling_comes_before_zero():
    # The third motor carries the second along: q3 = m3 - m2, and reads 0.1 rad more than the pendant.
    angles = motor_angles((180.0, 180.0), ((1.0, 0.0), (-1.0, 1.0)), (0.0, 0.1))
    assert angles((90 * 180, 30 * 180)) == pytest.approx([math.pi / 2, math.pi / 6 - math.pi / 2 + 0.1])
