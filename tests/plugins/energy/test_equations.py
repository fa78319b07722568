"""The paper's equations on signals whose integrals are known on paper."""

import pytest

from cellwatt_plugins.energy import equations


def test_brake_power_leaves_out_what_holds_the_arm():
    assert equations.brake_power(100.0, 50.0, 30.0, hold=1.5) == pytest.approx(18.5)
