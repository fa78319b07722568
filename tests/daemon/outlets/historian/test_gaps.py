"""Spans to fill in: as sets of moments."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.outlets.historian.gaps import MOST, Gaps

spans = st.tuples(st.integers(0, 40), st.integers(0, 10)).map(lambda s: (s[0], s[0] + s[1]))


def moments(gaps) -> set[int]:
    return {n for start, end in gaps for n in range(start + 1, end + 1)}


@given(st.lists(st.tuples(st.booleans(), spans), max_size=30))
def test_spans_are_sets(steps) -> None:
    gaps, truth = Gaps(), set()
    for adds, span in steps:
        if adds:
            gaps.add(*span)
            truth |= moments([span])
        else:
            gaps.remove(*span)
            truth -= moments([span])
    assert moments(gaps) == truth
    ordered = list(gaps)
    assert all(a[1] < b[0] for a, b in pairwise(ordered))
    assert gaps.length == len(truth)
    assert bool(gaps) == bool(truth)


def test_the_oldest_comes_first_when_it_is_settled() -> None:
    gaps = Gaps([(100, 200), (0, 50)])
    assert gaps.first(30, before=1000) == (0, 30)
    assert gaps.first(30, before=29) is None
    gaps.remove(0, 50)
    assert gaps.first(500, before=199) is None
    assert gaps.first(500, before=200) == (100, 200)


def test_spans_stay_few_and_nothing_is_forgotten() -> None:
    gaps = Gaps((10 * n, 10 * n + 1) for n in range(MOST + 50))
    assert len(list(gaps)) == MOST
    assert {10 * n + 1 for n in range(MOST + 50)} <= moments(gaps)
