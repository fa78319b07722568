"""Rows of a logger that is faster than the controller."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.explain.input.repeated_rows import repeats

from .test_stamps import EVEN, ROWS, STEP, positions


@pytest.mark.parametrize("faster", [1.3, 2.0, 5.0])
def test_repeated_rows_are_found(faster):
    rest = EVEN + np.where(np.abs(np.arange(ROWS) - 1000) < 200, EVEN[1000] - EVEN, 0)
    time = np.arange(EVEN[0], EVEN[-1], STEP / faster)
    held = np.searchsorted(EVEN, time + 1e-9, side="right") - 1
    left = ~repeats([values[held] for values in positions(rest, 0.0)])
    moving = np.abs(held - 1000) > 220
    np.testing.assert_array_equal(held[left & moving], np.unique(held[moving]))
    assert np.sum(left) == pytest.approx(ROWS, rel=0.05), "at rest as many rows remain as in motion"


def test_coarse_encoders_repeat_no_row():
    slow = [np.round(values * 1000 / 6.28) for values in positions(100 + 0.02 * (EVEN - 100), 0.0)]
    assert np.mean(np.all(np.diff(np.column_stack(slow), axis=0) == 0, axis=1)) > 0.1
    assert not repeats(slow).any()
    assert not repeats(positions(EVEN, 1e-5)).any()


@pytest.mark.parametrize(("rate", "move", "rest"), [(2, 2.0, 1.5), (5, 1.0, 0.2), (10, 1.0, 0.3), (25, 1.0, 0.28)])
def test_short_exact_rests_are_no_repetitions(rate, move, rest):
    """From point to point, in the thousandths of a degree that a controller gives."""
    time = np.arange(0, 120, 1 / rate)
    number = (time // (move + rest)).astype(int)
    share = np.clip((time - number * (move + rest)) / move, 0, 1)
    points = np.random.default_rng(8).uniform(-60, 60, (number[-1] + 2, 6))
    way = (10 * share**3 - 15 * share**4 + 6 * share**5)[:, None]
    degrees = np.round(points[number] + way * (points[number + 1] - points[number]), 3)
    assert np.any(np.all(np.diff(degrees, axis=0) == 0, axis=1))
    assert not repeats(list(np.radians(degrees).T)).any()
