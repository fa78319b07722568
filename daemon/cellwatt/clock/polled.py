"""Time stamps of polled samples, and unwrapping of a device's counters."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Nanoseconds


def middle(asked: int, arrival: int, n: int = 1, after: int | None = None) -> tuple[Nanoseconds, Nanoseconds]:
    """Time and bound, each (n,) ns, of n samples that answer one request.

    ``asked`` and ``arrival`` are the cell's time when the request was sent and the reply arrived; the samples were
    made in between, so the time is the middle and the bound half the round trip. Times rise by 1 ns from
    sample to sample, and above ``after``, the last time stated before; the bound grows by as much.
    """
    start = (asked + arrival) // 2
    late = 0 if after is None else max(0, after + 1 - start)
    half = max(0, (arrival - asked + 1) // 2)
    count = np.arange(n, dtype=np.int64)
    return start + late + count, half + late + count


def unwrapped(value: int, wrap: int, near: float) -> int:
    """Return the number that is ``value`` modulo ``wrap`` and nearest to ``near``."""
    return value + wrap * round((near - value) / wrap)
