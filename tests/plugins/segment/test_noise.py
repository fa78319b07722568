import numpy as np
import pytest

from cellwatt_plugins.segment.noise import CHUNK, NoiseEstimate


@pytest.mark.parametrize("sigma", [1e-5, 1e-4, 1e-3])
def test_noise_is_estimated_under_smooth_motion(sigma):
    random = np.random.default_rng(1)
    t = np.arange(20 * CHUNK) / 50
    q = np.column_stack([np.sin(1.3 * t), 0 * t]) + sigma * random.standard_normal((len(t), 2))
    noise = NoiseEstimate(2)
    for part in np.split(q, 20):
        noise.add(part)
    assert noise.sigma == pytest.approx([sigma, sigma], rel=0.4)


def test_a_silent_encoder_has_none_and_a_jerk_is_none():
    q = np.zeros((4 * CHUNK, 1))
    q[CHUNK:] = 1.0
    noise = NoiseEstimate(1)
    for part in np.split(q, 4):
        noise.add(part)
    assert noise.sigma == pytest.approx([0.0])
