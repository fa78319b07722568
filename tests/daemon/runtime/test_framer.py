"""Frames are numbered on over changes of the settings, and over the processes that make them."""

from __future__ import annotations

import numpy as np

from cellwatt.batch import Batch
from cellwatt.config import FrameSettings
from cellwatt.runtime.framer import Framer
from tests.daemon.runtime.fakes import STEP, STREAM

STREAMS = {"arm": (STREAM,)}
START = 1_000 * STEP


def batches(n: int) -> list[Batch]:
    return [
        Batch(
            "arm",
            STREAM,
            i,
            START + i * STEP + 1000,
            np.array([START + i * STEP]),
            np.array([10]),
            np.array([[float(i), 1.0]]),
            np.zeros(1, np.uint8),
        )
        for i in range(n)
    ]


def test_a_framer_that_follows_another_gives_the_same_frames_but_those_given() -> None:
    whole = Framer(STREAMS, FrameSettings())
    given = [f for batch in batches(100) for f in whole.take(batch)]
    first, last = given[:40], given[40:]
    after = int(first[-1].time[-1])
    second = Framer(STREAMS, FrameSettings(), first[-1].sequence + len(first[-1]), after)
    again = [f for batch in batches(100)[20:] for f in second.take(batch)]
    for name in ("time", "values", "quality", "bound"):
        ours = np.concatenate([getattr(f, name) for f in again])
        assert np.array_equal(ours, np.concatenate([getattr(f, name) for f in last]))
    assert again[0].sequence == last[0].sequence


def test_a_change_numbers_on_and_gives_no_time_twice() -> None:
    """A slower source sends samples of before the change after it."""
    framer = Framer(STREAMS, FrameSettings())
    first = [f for batch in batches(50) for f in framer.take(batch)] + list(framer.flush())
    framer.change(STREAMS, FrameSettings(rate=25.0))
    second = [f for batch in batches(100)[45:] for f in framer.take(batch)]
    assert second[0].sequence == first[-1].sequence + len(first[-1])
    assert second[0].time[0] > first[-1].time[-1]
    assert second[0].layout.rate == 25.0
    assert framer.status()["count"] == framer.sequence
