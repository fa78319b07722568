"""Moments go out at the distance of their times, and none waits for long."""

from __future__ import annotations

import math
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.outlets.foxglove.serving import HURRY, LAG, Pace
from cellwatt.outlets.foxglove.topics import Moment


def run(blocks: list[tuple[float, int]], step: float) -> list[float]:
    """When each moment goes out, for blocks of n moments that arrive at given times."""
    pace, out, arriving, now = Pace(), [], list(blocks), 0.0
    while arriving or pace.wait(now) < math.inf:
        now = min(arriving[0][0] if arriving else math.inf, now + pace.wait(now))
        while arriving and arriving[0][0] <= now:
            for _ in range(arriving.pop(0)[1]):
                pace.add(Moment(0, (), step), now)
        out += [now for _ in pace.due(now)]
    return out


def test_blocks_of_frames_become_an_even_stream() -> None:
    out = run([(0.1 * i, 5) for i in range(1, 20)], 0.02)
    steps = {round(b - a, 9) for a, b in pairwise(out)}
    assert steps == {0.02}
    assert len(out) == 95


def test_what_comes_too_fast_is_hurried_but_never_all_at_once() -> None:
    out = run([(1.0, 5000)], 0.02)
    assert len(out) == 5000
    assert out[-1] < 1.0 + LAG + 5000 * HURRY + 1e-6
    for first, last in zip(out, out[500:], strict=False):
        assert last - first >= 499 * HURRY - 1e-6


@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.integers(0, 6)), max_size=40))
def test_nothing_waits_for_long_and_the_order_is_kept(blocks: list[tuple[float, int]]) -> None:
    at, arriving, came = 0.0, [], []
    for after, count in blocks:
        at += after
        arriving.append((at, count))
        came += [at] * count
    out = run(arriving, 0.01)
    assert out == sorted(out)
    assert len(out) == len(came)
    assert all(-1e-9 <= sent - arrived <= LAG + 240 * HURRY for sent, arrived in zip(out, came, strict=True))
