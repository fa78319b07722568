import numpy as np
import pytest

from cellwatt_plugins.noise import step_noise, white_noise

STEP = 0.008


@pytest.mark.parametrize("order", [3, 4])
def test_white_noise_is_found_in_motion_and_beside_gaps(order):
    t = np.arange(4000) * STEP
    noise = 1e-3 * np.random.default_rng(4).standard_normal(len(t))
    values = np.sin(t) + noise
    assert white_noise(values, order) == pytest.approx([1e-3], rel=0.1)
    values[::50] = np.nan
    silent = np.full(len(t), np.nan)
    found = white_noise(np.column_stack([values, silent]), order)
    assert found[0] == pytest.approx(1e-3, rel=0.1)
    assert np.isnan(found[1])


@pytest.mark.parametrize("rows", [0, 3])
def test_too_few_values_tell_no_noise(rows):
    assert np.isnan(white_noise(np.zeros((rows, 2)), 3)).all()


def test_steps_are_found_beside_missing_values():
    stepped = np.round(np.sin(np.arange(400) / 30.0), 1)
    stepped[::5] = np.nan
    assert step_noise(stepped[:, None]) == pytest.approx([0.1 / np.sqrt(12.0)])
