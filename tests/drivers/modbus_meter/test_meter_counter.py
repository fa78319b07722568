from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.modbus_meter.counter import RisingCounter

PERIOD = 0.2
N = 120


def taken(readings, wraps_at=None):
    counter = RisingCounter(wraps_at, PERIOD)
    return [counter.take(r, PERIOD * n) for n, r in enumerate(readings)]


def changes(found):
    return [c.change for c in found if c.change]


def rising(start=13423.7, step=0.001, n=N):
    return [start + step * k for k in range(n)]


def struck(readings, at, by):
    return [by(r) if n in at else r for n, r in enumerate(readings)]


MISREADINGS = {
    "zero once": ({40}, lambda r: 0.0),
    "zeros after a wake-up": (range(40, 60), lambda r: 0.0),
    "an older reading after a wake-up": (range(40, 60), lambda r: 13420.1),
    "a torn pair, too low": ({40}, lambda r: r - 65.536),
    "a torn pair, too high": ({40}, lambda r: r + 65.536),
    "garbage": ({40}, lambda r: 4e9),
    "garbage twice": ({40, 41}, lambda r: 4e9),
    "zero, then garbage": ({40, 41}, lambda r: 4e9 if r > 13423.7405 else 0.0),
    "the last digit falls": (range(9, 110, 10), lambda r: r - 0.1),
    "the last digit rises": (range(9, 110, 10), lambda r: r + 0.1),
    "the last digit rises a little": (range(9, 110, 10), lambda r: r + 0.004),
}


@pytest.mark.parametrize("what", MISREADINGS)
def test_what_is_taken_back_adds_nothing_and_is_marked(what):
    at, by = MISREADINGS[what]
    truth = rising()
    found = taken(struck(truth, at, by))
    assert set(changes(found)) == {"misread"}
    assert found[-1].value == pytest.approx(truth[-1], abs=1e-9)
    excess = max(c.value - t for c, t in zip(found, truth, strict=True) if c.value == c.value)
    assert excess <= 0.0041, "no more than a rise that may be true"
    off = [n for n in range(5, N) if found[n].value != pytest.approx(truth[n], abs=1e-9)]
    assert all(found[n].held for n in off if n not in at or excess <= 0)
    assert sum(c.misread for c in found) == len(at)


@pytest.mark.parametrize("false", [[0.0], [0.0, 0.0], [4e9], [1.5]])
def test_a_false_first_reading_leaves_no_trace(false):
    truth = rising()
    assert taken(false + truth)[-1].value == pytest.approx(truth[-1], abs=1e-9)


def test_nothing_is_given_before_two_readings_agree():
    assert [c.value for c in taken([4e9, 500.0, 500.0])[:2]] == [pytest.approx(math.nan, nan_ok=True)] * 2
    assert taken([500.0, 500.0])[1].value == 500.0


@pytest.mark.parametrize("start", [0.0, 13420.0])
def test_a_reset_or_an_older_reading_counts_on_and_not_twice(start):
    before = rising()
    found = taken(before + rising(start))
    assert changes(found) == ["reset"]
    assert found[-1].value == pytest.approx(before[-1] + 0.001 * (N - 1), abs=1e-9)
    assert start or [c.held for c in found[N : N + 5]] == [True, True, True, False, False]


def test_a_counter_set_back_that_stands_still_is_not_held_for_ever():
    found = taken(rising() + [0.0] * 400)
    assert changes(found) == ["reset"]
    assert not found[-1].held


def test_a_register_of_the_day_counts_on_over_midnight():
    """MaxGrmm/EF-PowerOcean-TcpModbus #57: it stands at 0 till dawn."""
    day = [0.0] * 400 + [0.1 * (n // 9) for n in range(900)]
    found = taken(day * 3)
    assert set(changes(found)) == {"reset"}
    assert found[-1].value == pytest.approx(3 * day[-1])
    assert sum(c.held for c in found) < len(day) / 2


@pytest.mark.parametrize("zeros", [400, 2000])
def test_a_reset_that_is_taken_back_late_is_undone(zeros):
    """As by a meter whose firmware is updated."""
    truth = rising(n=zeros + 400)
    found = taken(struck(truth, range(40, 40 + zeros), lambda r: 0.0))
    assert changes(found) == ["reset", "misread"]
    assert found[-1].value == pytest.approx(truth[-1], abs=1e-9)
    assert max(c.value for c in found if c.value == c.value) <= truth[-1] + 1e-9


@pytest.mark.parametrize("rises", [0, N])
def test_a_value_that_falls_steadily_is_told_once(rises):
    """As import less export."""
    found = taken(rising(n=rises) + [13423.0 - 0.001 * n for n in range(700)])
    assert changes(found) == ["held"]
    assert 60 / PERIOD <= [c.change for c in found].index("held") - rises <= 60 / PERIOD + 2


def test_load_that_begins_at_once_is_believed_soon():
    found = taken(rising(step=1e-5) + rising(13423.8, step=0.01))
    assert changes(found) == []
    assert sum(c.held for c in found[10:]) <= 3
    assert found[-1].value == pytest.approx(13423.8 + 0.01 * (N - 1))


@pytest.mark.parametrize("zero_at", [None, 97, 100, 101])
def test_a_wrap_loses_nothing_also_with_a_zero_beside_it(zero_at):
    truth = [9900.0 + n for n in range(N)]
    found = taken(struck([t % 1e4 for t in truth], {zero_at}, lambda r: 0.0), 1e4)
    assert changes(found).count("wrapped") == 1
    assert found[-1].value == truth[-1]


def test_nothing_read_changes_nothing():
    readings = rising()
    found = taken([*readings[:40], math.nan, *readings[40:]])
    assert math.isnan(found[40].value)
    assert changes(found) == []
    assert found[-1].value == readings[-1]


@given(st.floats(0, 999), st.lists(st.floats(1, 9), min_size=8, max_size=200))
def test_wraps_are_unwound_whatever_the_steps(start, steps):
    truth = [start, start, *itertools.accumulate(steps, initial=start)]
    found = taken([t % 1000.0 for t in truth], 1000.0)
    believed = [(c.value, t) for c, t in zip(found, truth, strict=True) if not c.held and c.value == c.value]
    assert [value for value, _ in believed] == pytest.approx([t for _, t in believed], abs=1e-6)
    assert len(believed) >= 3


@given(st.lists(st.floats(0, 1e12), min_size=1), st.one_of(st.none(), st.floats(1, 1e12)))
def test_it_never_falls(readings, wraps_at):
    values = [c.value for c in taken(readings, wraps_at) if not math.isnan(c.value)]
    assert all(b >= a for a, b in itertools.pairwise(values))
