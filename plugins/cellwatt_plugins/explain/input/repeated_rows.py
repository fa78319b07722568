"""Rows that repeat the row before: the logger is faster than what it logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Bool, Float

MOST_REPEATED = 8
"""Distance, in rows, of two samples above which the arm stands still: rows in between are no repetitions."""
REPEATED = 0.02
"""Repetitions per sample of a moving arm above which the logger is faster than the controller."""
COUNTS = 8.0
"""Step of a position, in its smallest steps, before which a sample would have shown some of the motion."""
AMID = 0.5
"""Step of a joint, as a share of its largest steps, from which the joint is amid a move."""
FEWEST = 9
"""Smallest number of samples in motion that show how many rows a sample has."""


def repeats(positions: Sequence[Float]) -> Bool:
    """True (N,) at rows that repeat the ``positions``, each (N,), of the row before, as the logger is the faster one.

    At rest, where samples are alike, as many rows as in motion count as repetitions.
    """
    steps = np.abs(np.diff(np.column_stack(positions), axis=0))
    least = np.min(steps, axis=0, where=steps > 0, initial=np.inf)
    fresh = np.flatnonzero((steps > 0).any(axis=1)) + 1
    apart = np.diff(fresh, prepend=0)
    moved = steps[fresh - 1]
    fast = (apart <= MOST_REPEATED) & (moved >= COUNTS * least).any(axis=1)
    if fast.any():
        # A short rest lasts longer than repetitions do, or the step after it is that of a joint that gathers speed.
        amid = (moved >= AMID * np.quantile(moved[fast], 0.9, axis=0)).any(axis=1)
        fast &= amid & (apart <= 2 * np.median(apart[fast]))
    out = np.zeros(len(steps) + 1, np.bool_)
    if fast.sum() >= FEWEST and (every := float(apart[fast].mean())) > 1 + REPEATED:
        out[:] = True
        out[[0, *fresh]] = False
        for first, rows in zip(fresh - apart, apart, strict=True):
            if rows > MOST_REPEATED:
                out[first : first + rows : round(every)] = False
    return out
