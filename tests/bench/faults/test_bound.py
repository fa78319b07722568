import numpy as np
import pytest
from faults.bound import LEVEL, THRESHOLD, signal_to_noise, signal_to_spread, told_at_best
from faults.tasks import Path

MOVE = np.repeat([-1, 0, -1, 1, -1], 20)
PATH = Path(np.zeros((100, 1)), np.zeros((100, 1)), np.zeros((100, 1)), MOVE)
EFFECT = np.where(MOVE == 0, 3.0, np.where(MOVE == 1, 50.0, 0.0))
OTHER = np.where(MOVE == -1, 1.0, 0.0)


def test_only_what_was_measured_by_the_end_of_the_move_counts():
    assert signal_to_noise(PATH, 1, EFFECT, [OTHER], 2.0) == pytest.approx(1.5 * np.sqrt(20))
    assert signal_to_noise(PATH, 2, EFFECT, [OTHER], 2.0) == pytest.approx(np.sqrt(20 * 1.5**2 + 20 * 25**2))


def test_a_fault_that_a_harmless_change_may_make_cannot_be_told():
    assert signal_to_noise(PATH, 1, EFFECT, [2.0 * EFFECT], 2.0) == pytest.approx(0.0, abs=1e-6)


def test_of_a_fault_larger_than_any_harmless_change_the_rest_counts():
    assert signal_to_noise(PATH, 1, EFFECT, [0.4 * EFFECT], 2.0) == pytest.approx(0.6 * 1.5 * np.sqrt(20))


def test_the_best_detector_by_drawing():
    """Noise drawn beside noise and a known signal: the share that is above the limit of the accepted share."""
    drawn = np.random.default_rng(1).standard_normal(200_000)
    for ratio in (0.0, 3.0, 5.0):
        assert np.mean(drawn + ratio > THRESHOLD) == pytest.approx(told_at_best(ratio), abs=0.005)


def test_a_spread_without_bound_is_that_of_the_covariance():
    covariance = 4.0 * np.eye(40) + np.outer(OTHER[:40], OTHER[:40]) + LEVEL**2
    expected = np.sqrt(EFFECT[:40] @ np.linalg.solve(covariance, EFFECT[:40]))
    assert signal_to_spread(PATH, 1, EFFECT, [OTHER], 2.0) == pytest.approx(expected)
    assert expected < signal_to_noise(PATH, 1, EFFECT, [OTHER], 2.0)
