"""Gaps and time bases from timestamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.ur.continuity import WINDOW, Grid, TimeBase

MS = 1_000_000


def count(grid: Grid, steps: np.ndarray, chunk: int = 7) -> int:
    return sum(grid.missing(steps[i : i + chunk]) for i in range(0, len(steps), chunk))


@pytest.mark.parametrize(("period", "loss", "chunk"), [(2 * MS, 0.01, 1), (8 * MS, 0.5, 7), (40 * MS, 0.2, 400)])
def test_every_loss_on_a_grid_is_counted(period, loss, chunk):
    chance = np.random.default_rng(1)
    kept = np.flatnonzero(chance.random(2000) >= loss)
    stamps = np.rint((1234.567 + kept * (period / 1e9)) * 1e9).astype(np.int64)
    missing = kept[-1] - kept[0] + 1 - len(kept)
    assert count(Grid(), np.diff(stamps), chunk) == missing


def test_a_source_slower_than_asked_for_loses_nothing():
    grid = Grid()
    assert count(grid, np.full(500, 8 * MS)) == 0
    assert grid.step == 8 * MS
    assert count(grid, np.array([24 * MS])) == 2


def test_uneven_times_are_no_losses():
    chance = np.random.default_rng(2)
    steps = chance.choice([9, 10, 11, 12, 13, 34], size=2000, p=[0.1, 0.4, 0.2, 0.2, 0.09, 0.01]) * MS
    grid = Grid()
    assert count(grid, steps) == 0
    assert grid.step is None


def test_a_grid_that_is_no_longer_kept_is_given_up():
    grid = Grid()
    assert count(grid, np.full(WINDOW, 10 * MS)) == 0
    assert grid.step == 10 * MS
    chance = np.random.default_rng(3)
    assert count(grid, chance.integers(12, 18, 3 * WINDOW) * MS) == 0
    assert grid.step is None


@given(st.lists(st.integers(1, 10**13), max_size=300))
def test_missing_is_never_negative(steps):
    assert count(Grid(), np.array(steps, dtype=np.int64)) >= 0


NOW = 1_790_000_000_000_000_000


def fed(base: TimeBase, seconds: float = 20.0, drift: float = 0.0) -> tuple[int, int]:
    """Feed a base with packages at 500 Hz, 0 to 5 ms late, and a bracket each second."""
    chance = np.random.default_rng(4)
    device = now = 0
    for i in range(int(seconds * 500)):
        device = 60_000 * MS + i * 2 * MS
        made = NOW + round(i * 2 * MS * (1 + drift))
        now = made + int(chance.integers(0, 5 * MS))
        assert base.arrived(device, now)
        if i % 500 == 499:
            assert base.made_after(device, made - 2 * MS)
    return device, now


@pytest.mark.parametrize("drift", [7e-4, -7e-4])
def test_drift_and_jitter_are_the_same_base(drift):
    fed(TimeBase(), 120.0, drift)


def test_bounds_widen_with_the_time_since_they_were_seen():
    """The two times run apart by 700 ppm, while packages, then questions, stay out for long."""
    silent = TimeBase()
    assert silent.arrived(0, NOW)
    assert silent.made_after(60_000 * MS, NOW + 60_042 * MS)
    slowing = TimeBase()
    assert slowing.made_after(0, NOW)
    assert slowing.made_after(100_000 * MS, NOW + 99_930 * MS)  # a newer bound, though below the older one
    assert not slowing.arrived(100_050 * MS, NOW + 99_940 * MS)
    asked = TimeBase()
    assert asked.made_after(0, NOW)
    assert asked.arrived(100_000 * MS, NOW + 99_930 * MS)
    heard = TimeBase()
    assert heard.arrived(0, NOW)
    assert heard.arrived(100_000 * MS, NOW + 100_010 * MS)  # a newer bound, though above the older one
    assert not heard.made_after(100_000 * MS, NOW + 100_065 * MS)
