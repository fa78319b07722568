"""The Bayesian fit, on problems whose answer is known."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.models.static.evidence import Belief, fit


def problem(seed=0, noise=(0.1, 0.3), count=200):
    """Two outputs, linear in six parameters in three groups; the last group does nothing."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(count, 2, 6))
    truth = np.array([1.0, -2.0, 0.3, 0.5, 0.0, 0.0])
    measured = slopes @ truth + rng.normal(size=(count, 2)) * noise
    prior = Belief(
        (slice(0, 2), slice(2, 4), slice(4, 6)), np.ones(6), np.full(3, 3.0), np.array([0.2, 0.2]), ((0, 1),) * 3
    )
    return slopes, truth, measured, prior


def test_it_finds_parameters_noise_and_which_groups_are_there():
    slopes, truth, measured, prior = problem()
    found = fit(lambda p: (slopes @ p, slopes.copy()), measured, np.ones((200, 2), bool), prior)
    np.testing.assert_array_equal(found.active, [True, True, False])
    assert (np.abs(found.mean[:4] - truth[:4]) < 3.5 * found.deviation[:4]).all()
    np.testing.assert_array_equal(found.mean[4:], 0.0)
    np.testing.assert_allclose(found.noise, [0.1, 0.3], rtol=0.15)
