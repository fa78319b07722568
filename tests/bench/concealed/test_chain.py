"""Sensors and supply against worked numbers."""

from dataclasses import replace

import numpy as np
import pytest
from concealed.sensing import (
    Clipping,
    CrossTalk,
    DeadBand,
    averaged,
    coloured,
    draw_interface,
    lag,
    low_pass,
    report_torque,
)
from concealed.supply import Brake, Fan, Iron, Pulses, Supply, Winding, released, running

GRID = np.arange(0.0, 4.0, 0.001)


def ramp() -> np.ndarray:
    return np.stack([5.0 * GRID, -2.0 * GRID], axis=1)


def interface(**change):
    rng = np.random.default_rng(0)
    return replace(draw_interface(rng, np.array([0.1, 0.1]), 1.0, 100.0), skew=0.0, **change)


def test_filters_delay_a_ramp_by_what_is_compensated():
    t = np.array([1.0, 2.0, 3.0])
    assert np.allclose(report_torque(interface(), t, GRID, ramp()), np.outer(t, [5.0, -2.0]), atol=1e-9)
    late = low_pass(ramp(), 0.004, 0.001)[2000, 0]
    assert late == pytest.approx(5.0 * (2.0 - lag(0.004, 0.001)))


def test_delay_and_running_clock_make_the_torque_late():
    t = np.array([1.0, 2.0])
    assert np.allclose(report_torque(interface(delay=0.02), t, GRID, ramp())[:, 0], 5.0 * (t - 0.02))
    assert np.allclose(report_torque(interface(clock_rate=0.01), t, GRID, ramp())[:, 0], 5.0 * (t - 0.01 * t))


def test_sensors_do_what_they_say():
    torque = np.array([[1.0, 4.0], [-3.0, 0.2]])
    t = np.zeros(2)
    assert Clipping(0, 2.0).read(t, torque.copy()).tolist() == [[1.0, 4.0], [-2.0, 0.2]]
    assert DeadBand(1, 0.5).read(t, torque.copy()).tolist() == [[1.0, 4.0], [-3.0, 0.0]]
    assert CrossTalk(0, 1, 0.5).read(t, torque.copy()).tolist() == [[3.0, 4.0], [-2.9, 0.2]]


def test_mean_over_a_window_is_centred():
    step = (GRID >= 2.0).astype(float)[:, None]
    mean = averaged(step, 0.01, 0.001)[:, 0]
    assert mean[1999] == pytest.approx(1 - mean[2000])
    assert mean[1990] == 0.0
    assert mean[2010] == 1.0


def test_noise_has_unit_variance_and_the_colour_it_is_given():
    noise = coloured(np.random.default_rng(1), 40000, 1, 0.3, 100.0)[:, 0]
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(0.3 * np.exp(-0.4), abs=0.02)


TORQUE, SPEED = np.full((4000, 1), 10.0), np.full((4000, 1), 0.5)
PLAIN = Supply(50.0, np.array([0.8]), np.array([5.0]))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, 50 + 5 + 3.2),
        ({"efficiency": 0.5}, 50 + 8.2 / 0.5),
        ({"iron": Iron(np.array([2.0]), np.array([4.0]))}, 50 + 8.2 + 1 + 1),
        ({"brake": Brake(12.0, 0.5)}, 50 + 8.2 + 12),
        ({"pulses": Pulses(7.0, 1.0, 1.0)}, 50 + 8.2 + 7),
    ],
)
def test_supply_power_adds_up(change, expected):
    assert replace(PLAIN, **change).power(GRID, TORQUE, SPEED)[-1] == pytest.approx(expected)


def test_returned_power_goes_back_through_the_converter_or_into_the_resistor():
    assert replace(PLAIN, efficiency=0.5).power(GRID, TORQUE, -SPEED)[0] == pytest.approx(50 - 1.8 * 0.5)
    assert replace(PLAIN, dissipates=True).power(GRID, TORQUE, -SPEED)[0] == pytest.approx(50.0)


def test_windings_warm_by_their_own_loss():
    warm = replace(PLAIN, winding=Winding(np.array([10.0]), 0.1)).power(GRID, TORQUE, SPEED)
    assert warm[-1] == pytest.approx(55 + 3.2 * (1 + 0.00393 * 32), rel=1e-6)


def test_brakes_close_after_their_delay():
    v = np.zeros((100, 2))
    v[20:30, 1] = 0.2
    assert np.flatnonzero(released(v, 0.1, 0.01)).tolist() == list(range(20, 40))


def test_fan_runs_between_its_two_temperatures():
    fan = Fan(10.0, 30.0, 40.0, 36.0, 10.0, 0.2, 0.3, 25.0)
    on = running(fan, np.full(60000, 100.0), 0.001)
    first = np.argmax(on) * 0.001
    assert first == pytest.approx(10.0 * np.log((45 - 30) / (45 - 40)), abs=0.1)
    assert np.argmin(on[np.argmax(on) :]) * 0.001 == pytest.approx(10.0 * np.log((40 - 31) / (36 - 31)), abs=0.1)
