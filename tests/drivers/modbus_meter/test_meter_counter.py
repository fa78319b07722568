from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.modbus_meter.counter import RisingCounter


def taken(readings, wraps_at=None):
    counter = RisingCounter(wraps_at)
    return [counter.take(r) for r in readings]


def test_a_wrap_loses_nothing():
    assert taken([970.0, 990.0, 5.0, 15.0], 1000.0) == [
        (970.0, None), (990.0, None), (1005.0, "wrapped"), (1015.0, None),
    ]  # fmt: skip


def test_a_reset_goes_on_from_the_last_value():
    assert taken([500.0, 520.0, 3.0, 8.0], 1000.0) == [(500.0, None), (520.0, None), (520.0, "reset"), (525.0, None)]


def test_without_a_known_end_every_fall_is_a_reset():
    assert taken([990.0, 5.0, 6.0]) == [(990.0, None), (990.0, "reset"), (991.0, None)]


def test_a_restored_older_reading_does_not_count_twice():
    assert [v for v, _ in taken([5000.0, 4999.5, 5000.5])] == [5000.0, 5000.0, 5001.0]


def test_nothing_read_changes_nothing():
    found = taken([990.0, math.nan, 5.0], 1000.0)
    assert math.isnan(found[1][0])
    assert found[2] == (1005.0, "wrapped")


@given(st.floats(0, 999), st.lists(st.floats(0, 90), max_size=60))
def test_wraps_are_unwound_whatever_the_steps(start, steps):
    truth, readings = [start], [start]
    for step in steps:
        truth.append(truth[-1] + step)
        readings.append(truth[-1] % 1000.0)
    assert [v for v, _ in taken(readings, 1000.0)] == pytest.approx(truth, abs=1e-6)


@given(st.lists(st.floats(0, 1e12), min_size=1), st.one_of(st.none(), st.floats(1, 1e12)))
def test_it_never_falls(readings, wraps_at):
    values = [v for v, _ in taken(readings, wraps_at)]
    assert all(b >= a - 1e-9 * abs(a) - 1e-9 for a, b in itertools.pairwise(values))
