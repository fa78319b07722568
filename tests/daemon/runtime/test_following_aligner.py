"""Frames are numbered on over changes of the settings, and over the processes that make them."""

from __future__ import annotations

import numpy as np

from cellwatt.align import Aligner
from cellwatt.batch import Batch
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


def test_an_aligner_that_follows_another_gives_the_same_frames_but_those_given() -> None:
    whole = Aligner(STREAMS, 50.0, 0.1)
    given = [f for batch in batches(100) for f in whole.add(batch)]
    first, last = given[:40], given[40:]
    after = int(first[-1].time[-1])
    second = Aligner(STREAMS, 50.0, 0.1, sequence=first[-1].sequence + len(first[-1]), after=after)
    assert second.reached == after
    again = [f for batch in batches(100)[20:] for f in second.add(batch)]
    for name in ("time", "values", "quality", "bound"):
        ours = np.concatenate([getattr(f, name) for f in again])
        assert np.array_equal(ours, np.concatenate([getattr(f, name) for f in last]))
    assert again[0].sequence == last[0].sequence


def test_a_change_numbers_on_and_gives_no_time_twice() -> None:
    """A slower source sends samples of before the change after it."""
    before = Aligner(STREAMS, 50.0, 0.1)
    first = [f for batch in batches(50) for f in before.add(batch)] + before.flush()
    aligner = Aligner(STREAMS, 25.0, 0.1, sequence=before.sequence, after=before.reached)
    second = [f for batch in batches(100)[45:] for f in aligner.add(batch)]
    assert second[0].sequence == first[-1].sequence + len(first[-1])
    assert second[0].time[0] > first[-1].time[-1]
    assert second[0].layout.rate == 25.0
    assert aligner.status()["count"] == aligner.sequence
