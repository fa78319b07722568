"""Frames on their way to the simulation, and the rows that are kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_plugins.explain.live.history import History
from cellwatt_plugins.explain.live.window import Window

STEP = 20_000_000
EDGE, BRIDGED = 20, 5
"""Frames at 50 Hz of 0.4 s and of 0.1 s."""


def fed(values, time, cuts=(), lead=0.0):
    window = Window([0], STEP, lead)
    out = []
    edges = [0, *sorted(c % (len(time) + 1) for c in cuts), len(time)]
    numbers = np.arange(len(time))
    for first, last in pairwise(edges):
        for settled in window.feed(time[first:last], numbers[first:last], values[first:last]):
            out += settled
    return window, out


def grid(count):
    return 10**18 + STEP * np.arange(count)


def given_numbers(stretches):
    return np.concatenate([np.empty(0, np.int64), *(s.sequence[s.new] for s in stretches)]).tolist()


@settings(max_examples=60, deadline=None)
@given(
    holes=st.lists(st.tuples(st.integers(0, 400), st.integers(1, 30)), max_size=5),
    cuts=st.lists(st.integers(0, 400), max_size=12),
)
def test_what_is_given_does_not_depend_on_the_cuts_and_keeps_off_the_holes(holes, cuts):
    values = np.random.default_rng(1).standard_normal((400, 2))
    for at, length in holes:
        values[at : at + length, 0] = np.nan
    missing = np.isnan(values[:, 0])
    whole_window, whole = fed(values, grid(400))
    window, parts = fed(values, grid(400), cuts)
    numbers = given_numbers(parts)
    assert numbers == given_numbers(whole)
    assert window.counts == whole_window.counts
    assert numbers == sorted(set(numbers))
    long_holes = [i for i in range(400 - BRIDGED) if missing[i : i + BRIDGED + 1].all()]
    for hole in long_holes:
        assert not set(range(hole - EDGE, hole + BRIDGED + EDGE + 1)) & set(numbers)
    far = [n for n in range(EDGE, 350 - EDGE) if not missing[max(0, n - EDGE - BRIDGED) : n + EDGE + BRIDGED + 1].any()]
    assert set(far) <= set(numbers), "all that is far from what is missing is given"


def test_short_holes_are_bridged_and_marked():
    values = np.column_stack([np.arange(200.0), np.arange(200.0)])
    values[70:75] = np.nan
    window, stretches = fed(values, grid(200))
    assert given_numbers(stretches) == list(range(EDGE, 200 - EDGE))
    bridged = np.concatenate([s.sequence[s.new][s.bridged[s.new]] for s in stretches])
    assert bridged.tolist() == [70, 71, 72, 73, 74]
    for s in stretches:
        np.testing.assert_allclose(s.values[:, 0], s.sequence, err_msg="the motion is interpolated")
        assert np.isnan(s.values[s.bridged, 1]).all(), "nothing else is"
    assert window.counts["missing"] == 5


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 10), max_size=40))
def test_history_keeps_the_newest_rows(sizes):
    history = History(25, 1)
    total = 0
    for size in sizes:
        rows = np.arange(total, total + size)
        history.add(rows * 10, rows[:, None].astype(float))
        total += size
    time, rows = history.between(0, 10**6)
    assert time.tolist() == [10 * n for n in range(max(0, total - 25), total)]
    assert rows[:, 0].tolist() == list(range(max(0, total - 25), total))
    inside, _ = history.between(10 * (total - 5), 10 * (total - 2))
    assert inside.tolist() == [10 * n for n in range(max(0, total - 5), max(0, total - 1))]
