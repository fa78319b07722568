import numpy as np
import pytest

from bench.faults import rivals

T = np.arange(0, 8, 0.04)


def test_each_family_finds_what_is_its_own():
    bells = 120 + sum(40 * np.exp(-(((T - b) / 0.3) ** 2)) for b in (1.0, 2.5, 4.0, 6.0))
    waves = sum(a * np.sin(w * T + 0.3) for a, w in ((100, 0.3), (20, 2.2), (9, 5.0)))
    own = {
        rivals.gaussian: bells - 120,
        rivals.fourier: 90 + 10 * np.cos(0.7 * T) - 4 * np.sin(8 * 0.7 * T),
        rivals.sines: waves,
        rivals.polynomial: 100 + (T - 3) ** 3 - 0.001 * T**9 / 4**6,
    }
    for family, power in own.items():
        assert np.sqrt(np.mean((family(T, power) - power) ** 2)) < 0.05, family


def test_slopes_are_those_of_the_sums():
    random = np.random.default_rng(4)
    shapes = {rivals._BELLS: [2.0, 1.5, 5.0, 0.8], rivals._WAVES: [0.7, 2.1], rivals._HARMONICS: [0.8]}
    for family, shape in shapes.items():
        shape = np.array(shape)
        amplitudes = random.standard_normal(family.columns(T, shape).shape[1])
        slopes = family.slopes(T, shape, amplitudes)
        for k in range(len(shape)):
            step = np.zeros(len(shape))
            step[k] = 1e-6
            up, down = (family.columns(T, shape + s) @ amplitudes for s in (step, -step))
            assert slopes[:, k] == pytest.approx((up - down) / 2e-6, abs=1e-5)


def test_bells_and_their_slopes_stay_finite_however_narrow_and_far_off():
    with np.errstate(all="raise", under="ignore"):
        for narrow in (1e-200, 1.0, 1e160):
            shape = np.array([2.0, narrow, 1e140, narrow])
            assert np.isfinite(rivals._bells(T, shape)).all()
            assert np.isfinite(rivals._bell_slopes(T, shape, np.array([3.0, 100.0]))).all()
