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
        case "in a stall":
            stamps = stamped("by a busy PC", rng)[0]
            stamps[1000:1012] = EVEN[1012]
            return np.maximum.accumulate(stamps) + 1e-7 * np.arange(ROWS), EVEN
        case "with rows lost":
            there = rng.random(ROWS) > 0.03
            return (EVEN + rng.uniform(-0.2, 0.2, ROWS) * STEP)[there], EVEN[there]
        case "with a pause":
            there = np.abs(np.arange(ROWS) - 1000) > 300
            return (EVEN + rng.uniform(-0.2, 0.2, ROWS) * STEP)[there], EVEN[there]
        case "with a pause at the beginning" | "with a pause at the end":
            there = np.abs(np.arange(ROWS) - (2480 if "end" in how else 20)) > 5
            return (EVEN + rng.uniform(-0.2, 0.2, ROWS) * STEP)[there], EVEN[there]
    raise AssertionError(how)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize(
    "how",
    [
        "by a busy PC",
        "four at once",
        "in a stall",
        "with rows lost",
        "with a pause",
        "with a pause at the beginning",
        "with a pause at the end",
    ],
)
def test_rows_sampled_evenly_get_even_times_again(how, noise):
    stamps, truth = stamped(how, np.random.default_rng(3))
    found, exact = sampled(stamps, positions(truth, noise))
    assert exact
    assert np.std(np.diff(stamps) - np.diff(truth)) > 0.1 * STEP
    np.testing.assert_allclose(np.diff(found), np.diff(truth), rtol=1e-3)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("spread", [0.02, 0.3, 1.0])
def test_rows_sampled_unevenly_keep_their_stamps(spread, noise):
    time = EVEN[0] + np.cumsum(STEP + np.random.default_rng(4).exponential(spread * STEP, ROWS))
    assert sampled(time, positions(time, noise)) == (time, True)


@pytest.mark.parametrize("seed", range(10))
def test_rows_keep_their_stamps_beside_holes(seed):
    """With some rows lost, the number of those that a hole of seconds lacks is uncertain: no reason to move others."""
    rng = np.random.default_rng(seed)
    time = EVEN + 0.02 * STEP * rng.standard_normal(ROWS)
    there = np.ones(ROWS, bool)
    there[rng.integers(0, ROWS, 12)] = False
    for first in (800, 1700):
        there[first : first + 400] = False
    slow = [values[there] for values in positions(EVEN[0] + (time - EVEN[0]) / 6, 1e-5)]
    assert sampled(time[there], slow) == (pytest.approx(time[there], rel=0, abs=1e-9), True)


@pytest.mark.parametrize("middle", [600, 1000, 1250, 1500, 1900])
def test_some_missing_rows_stay_missing(middle):
    there = np.abs(np.arange(ROWS) - middle) > 3
    stamps = (EVEN + np.random.default_rng(3).uniform(-0.2, 0.2, ROWS) * STEP)[there]
    found, _ = sampled(stamps, positions(EVEN[there], 0.0))
    np.testing.assert_allclose(np.diff(found), np.diff(EVEN[there]), rtol=1e-3)


@pytest.mark.parametrize("spread", [0.2, 0.4])
def test_one_stall_shows_nothing_of_other_rows_that_were_sampled_unevenly(spread):
    truth = EVEN + np.random.default_rng(4).uniform(-spread, spread, ROWS) * STEP
    stamps = truth.copy()
    stamps[1000:1025] = truth[1025] - 1e-5 * np.arange(25, 0, -1)
    found, _ = sampled(stamps, positions(truth, 1e-5))
    assert np.std(np.diff(found)[:900] - np.diff(truth)[:900]) < 0.01 * STEP


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("period", [0.0022, 0.0065, 0.0079])
def test_rows_with_the_newest_sample_of_a_faster_controller_get_its_times(period, noise):
    loop = 100.0 + np.cumsum(STEP + np.random.default_rng(6).exponential(0.03 * STEP, ROWS))
    for stamps in (loop, EVEN + 0.0011):
        truth = np.floor(stamps / period) * period
        found, exact = sampled(stamps, positions(truth, noise))
        before, after = (np.std(np.diff(times) - np.diff(truth)) for times in (stamps, found))
        assert exact
        assert after < 0.2 * before


@pytest.mark.parametrize("row", [3, 1000])
def test_a_long_pause_hides_no_period(row):
    loop = 100.0 + np.cumsum(STEP + np.random.default_rng(6).exponential(0.03 * STEP, ROWS))
    truth = np.floor(loop / 0.0065) * 0.0065
    found, _ = sampled(loop + np.where(np.arange(ROWS) < row, 0, 86_400.0), positions(truth, 1e-5))
    before, after = (np.delete(np.diff(times) - np.diff(truth), row - 1) for times in (loop, found))
    assert np.std(after) < 0.2 * np.std(before)


def test_rows_sampled_nearly_at_once_stay_in_order():
    truth = np.sort(EVEN + np.random.default_rng(4).uniform(-0.6, 0.6, ROWS) * STEP)
    assert np.diff(truth).min() < 0.01 * STEP
    found, exact = sampled(EVEN, positions(truth, 1e-5))
    assert not exact
    assert np.all(np.diff(found) > 0)
    assert np.std(np.diff(found) - np.diff(truth)) < 0.2 * np.std(np.diff(EVEN) - np.diff(truth))


def test_one_joint_shows_no_time_of_a_row_as_it_may_shake():
    stamps, truth = EVEN, EVEN + np.random.default_rng(7).uniform(-0.2, 0.2, ROWS) * STEP
    assert sampled(stamps, positions(truth, 1e-5)[:1]) == (stamps, True)
    shaken = [values + 1e-3 * np.sin(70 * k * EVEN) for k, values in enumerate(positions(EVEN, 1e-5), start=1)]
    assert sampled(stamps, shaken) == (stamps, True)


@pytest.mark.parametrize("rate", [2, 10, 15, 50, 250])
def test_joints_that_start_and_stop_together_are_no_wrong_times(rate):
    time = np.arange(0, 60, 1 / rate)
    course = np.clip((time % 1.7) / 1.2, 0, 1)
    share = 10 * course**3 - 15 * course**4 + 6 * course**5
    share = np.where(time % 3.4 < 1.7, share, 1 - share)
    together = [size * share for size in (1.0, -0.7, 0.4, 1.3, -1.1, 0.2)]
    assert sampled(time, together) == (time, True)


def in_bursts(sizes, apart):
    """Stamps ``apart`` s of rows that come several at once throughout, each burst with its newest row in time."""
    counts = np.tile(sizes, ROWS)
    last = np.repeat(np.cumsum(counts) - 1, counts)[:ROWS]
    return EVEN[0] + STEP * last - apart * (last - np.arange(ROWS))


@pytest.mark.parametrize("apart", [5e-5, 2e-3])
@pytest.mark.parametrize("sizes", [(2,), (3,), (4,), (5,), (6,), (7,), (8,), (3, 6)])
def test_rows_that_come_several_at_once_throughout_get_even_times(sizes, apart):
    for noise in (0.0, 1e-5, 1e-3):
        found, exact = sampled(in_bursts(sizes, apart), positions(EVEN, noise))
        assert exact
        np.testing.assert_allclose(np.diff(found), np.diff(EVEN), rtol=1e-3)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("sizes", [(2,), (4,), (8,), (12,)])
def test_rows_that_were_sampled_in_bursts_keep_their_stamps(sizes, noise):
    stamps = in_bursts(sizes, 2e-3)
    assert sampled(stamps, positions(stamps, noise)) == (stamps, True)


def test_what_does_not_move_shows_nothing():
    stamps, truth = stamped("by a busy PC", np.random.default_rng(3))
    assert sampled(stamps, [np.full(len(truth), 0.3)]) == (stamps, True)
    assert sampled(stamps, [np.random.default_rng(5).normal(0, 1e-5, len(truth))]) == (stamps, True)
    assert sampled(stamps, []) == (stamps, True)
