import numpy as np
import pytest

from cellwatt_plugins.explain.fit.noise import correlation_factor, floor, hum, tones


def white(seed, count=6000, channels=2):
    return np.random.default_rng(seed).standard_normal((count, channels))


def autoregressive(rho, seed, count=40000):
    """Noise whose neighbours correlate by ``rho``, of variance 1."""
    drawn = np.random.default_rng(seed).standard_normal((count, 1))
    from scipy.signal import lfilter

    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], drawn, axis=0)


@pytest.mark.parametrize("step", [0.002, 0.008, 0.02])
def test_the_floor_of_white_noise_is_its_deviation(step):
    sigma = np.array([0.02, 7.0])
    assert floor([sigma * white(0), sigma * white(1)], [step, step]) == pytest.approx(sigma, rel=0.05)


def test_the_floor_is_above_zero_where_no_window_fits():
    assert floor([np.zeros((5, 2))], [0.02]) == pytest.approx([1e-9, 1e-9])


def test_the_floor_is_that_of_the_quiet_part():
    residual = white(5)
    residual[:2500] *= 10
    assert floor([residual], [0.008]) == pytest.approx([1, 1], rel=0.1)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6, 0.85])
def test_the_factor_of_autoregressive_noise_is_known(rho):
    found = correlation_factor([autoregressive(rho, 7)], [0.002])
    assert found[0] == pytest.approx((1 + rho) / (1 - rho), rel=0.12)


def test_what_stays_is_no_noise():
    """A residual that hardly changes is an effect: it counts as correlated over a quarter of a second at most."""
    slow = np.sin(2 * np.pi * 0.1 * np.arange(5000) * 0.01)[:, None]
    assert correlation_factor([slow], [0.01])[0] == pytest.approx(25)


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.9])
def test_noise_has_no_lines_however_a_filter_has_shaped_it(keep):
    noise = np.hstack([autoregressive(keep, seed, 6000) for seed in range(6)])
    assert np.max(tones([noise], [0.01])) < 0.05
    assert hum([noise[:, :1]], [0.01]) is None


@pytest.mark.parametrize("frequency", [5.0, 7.3, 15.0, 30.0])
def test_a_hum_that_never_stops_is_no_noise(frequency):
    time = np.arange(6000) * 0.01
    noise = 0.3 * np.random.default_rng(1).standard_normal((6000, 2))
    residual = noise + np.column_stack([np.sin(2 * np.pi * frequency * time), np.zeros(6000)])
    assert floor([residual], [0.01]) == pytest.approx(0.3, rel=0.2)
    assert hum([residual[:, :1]], [0.01]) == pytest.approx(frequency, abs=0.7)


def test_what_was_not_measured_is_no_quiet_noise():
    """Half of a channel is filled in; of another, every second sample is unknown, so that no window is whole."""
    time = np.arange(6000) * 0.01
    residual = white(6) + np.sin(2 * np.pi * 7.3 * time)[:, None]
    known = np.ones(residual.shape, bool)
    known[1000:4000, 0] = known[::2, 1] = False
    filled = np.where(known, residual, 0.0)
    found = floor([filled, filled], [0.01, 0.01], [known, known])
    assert found[0] == pytest.approx(1.0, rel=0.1)
    assert found[1] == floor([filled, filled], [0.01, 0.01])[1]
    assert tones([filled], [0.01], [known])[0] == pytest.approx(tones([residual], [0.01])[0], rel=0.1)
