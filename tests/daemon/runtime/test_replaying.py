"""Two runs of frames held against each other, bit by bit."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from cellwatt import Frames
from cellwatt.runtime.replaying import compare
from tests.daemon.runtime.fakes import STEP, frames_of


def changed(frames: Frames, **what: float) -> Frames:
    """The same with one number of its third frame changed."""
    (name, value), *_ = what.items()
    numbers = getattr(frames, name).copy()
    numbers[2, 0] = value
    return replace(frames, **{name: numbers})


def test_the_same_in_other_blocks():
    found = compare([frames_of(0, 10)], [frames_of(0, 4), frames_of(4, 6)])
    assert (found.equal, found.identical) == (10, True)


@pytest.mark.parametrize("what", [{"values": 5e-324}, {"values": -0.0}, {"quality": 1}, {"bound": 1}])
def test_a_bit_that_differs(what):
    found = compare([frames_of(0, 10)], [changed(frames_of(0, 10), **what)])
    assert (found.equal, found.different, found.first_difference, found.identical) == (9, 1, 2 * STEP, False)


def test_frames_of_one_run_only():
    found = compare([frames_of(0, 10)], [frames_of(3, 10)])
    assert (found.equal, found.only_recorded, found.only_replayed, found.identical) == (7, 3, 3, False)


def test_frames_are_compared_as_they_come_and_not_held():
    taken = Counter()

    def run(name):
        for n in range(50):
            taken[name] += 1
            assert abs(taken["recorded"] - taken["replayed"]) <= 1
            yield frames_of(10 * n, 10)

    assert compare(run("recorded"), run("replayed")).equal == 500
