"""The paper's equations on signals whose integrals are known on paper."""

import numpy as np
import pytest

from cellwatt_plugins.energy import equations


def test_fr3_at_50_mm_s_with_payload():
    """First row of Table III: 720 J of brakes at 18.6436 W, 2518.9 J of electronics."""
    seconds = 720.0 / 18.6436
    assert equations.electronics_energy(32.12, 33.09, seconds) == pytest.approx(2518.9, rel=1e-3)
    assert equations.electrical_losses(4128.3, 2518.9, 720.0, 4.5) == pytest.approx(884.8, abs=0.2)
    assert equations.payload_energy(4128.3, 3719.7) == pytest.approx(408.6)
    assert equations.payload_efficiency(4128.3, 3719.7) == pytest.approx(9.9, abs=0.05)


def test_brake_power_leaves_out_what_holds_the_arm():
    assert equations.brake_power(100.0, 50.0, 30.0, hold=1.5) == pytest.approx(18.5)


def test_motion_efficiency():
    assert equations.motion_efficiency(97.3, 847.1) == pytest.approx(11.49, abs=0.01)


def test_shares_of_mean_power_count_each_run_alike():
    energies = np.array([[90.0, 10.0], [50.0, 50.0]])
    shares = equations.mean_power_shares(energies, np.array([100.0, 1.0]))
    assert shares == pytest.approx([100 * 50.9 / 101, 100 * 50.1 / 101])
