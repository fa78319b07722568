"""Stamps of rows against the times at which the rows were sampled."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.explain.input.stamps import sampled

STEP, ROWS = 0.008, 2500
EVEN = 100.0 + STEP * np.arange(ROWS)
FREQUENCIES = np.random.default_rng(1).uniform(0.3, 6, (6, 4))


def positions(time, noise):
    """Six joints on sums of sines, with the noise of their encoders."""
    rng = np.random.default_rng(2)
    return [np.sin(time[:, None] * speeds).sum(axis=1) / 4 + rng.normal(0, noise, len(time)) for speeds in FREQUENCIES]


def stamped(how, rng):
    """Stamps of rows, and the times at which they were sampled."""
    match how:
        case "by a busy PC":
            return np.maximum.accumulate(EVEN + rng.exponential(0.3 * STEP, ROWS)) + 1e-7 * np.arange(ROWS), EVEN
        case "four at once":
            stamps = EVEN.copy()
            for first in rng.integers(0, ROWS - 4, 25):
                stamps[first : first + 4] = EVEN[first + 3]
            return np.maximum.accumulate(stamps) + 1e-7 * np.arange(ROWS), EVEN
        case "with rows lost":
            there = rng.random(ROWS) > 0.03
            return (EVEN + rng.uniform(-0.2, 0.2, ROWS) * STEP)[there], EVEN[there]
        case "with a pause":
            there = np.abs(np.arange(ROWS) - 1000) > 300
            return (EVEN + rng.uniform(-0.2, 0.2, ROWS) * STEP)[there], EVEN[there]
    raise AssertionError(how)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("how", ["by a busy PC", "four at once", "with rows lost", "with a pause"])
def test_rows_sampled_evenly_get_even_times_again(how, noise):
    stamps, truth = stamped(how, np.random.default_rng(3))
    found = sampled(stamps, positions(truth, noise))
    assert np.std(np.diff(stamps) - np.diff(truth)) > 0.1 * STEP
    np.testing.assert_allclose(np.diff(found), np.diff(truth), rtol=1e-3)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("spread", [0.02, 0.3, 1.0])
def test_rows_sampled_unevenly_keep_their_stamps(spread, noise):
    time = EVEN[0] + np.cumsum(STEP + np.random.default_rng(4).exponential(spread * STEP, ROWS))
    assert sampled(time, positions(time, noise)) is time


def test_what_does_not_move_shows_nothing():
    stamps, truth = stamped("by a busy PC", np.random.default_rng(3))
    assert sampled(stamps, [np.full(len(truth), 0.3)]) is stamps
    assert sampled(stamps, [np.random.default_rng(5).normal(0, 1e-5, len(truth))]) is stamps
    assert sampled(stamps, []) is stamps
