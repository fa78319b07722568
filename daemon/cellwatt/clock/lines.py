"""The straight lines (offset, drift) that are consistent with one-sided facts about a clock.

A fact is a pair (device time, offset), both ns: at that device time the true offset, cell time − device time, was at
most (fact from above) or at least (fact from below) this offset.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cellwatt.arrays import Float

SECOND = 1_000_000_000
BLOCK = 1 * SECOND
"""Length of a block, ns: of each side the tightest fact of a block is stored …"""
BLOCKS = 64
"""… for this many blocks."""
SPAN = 8
"""Consecutive blocks of which one is assumed to hold a sample with little delay: longer than any stall."""
MAX_DRIFT = 750e-6
"""A device's drift (200 ppm) and the cell clock's own slew (500 ppm), with a margin."""

Fact = tuple[int, float]


class Lines(NamedTuple):
    """At device time ``at`` the offset is in ``lower`` … ``upper``, ns, and its slope in ``slow`` … ``fast``."""

    at: int
    lower: float
    upper: float
    slow: float
    fast: float

    @property
    def slope(self) -> float:
        """The middle of the slopes."""
        return (self.slow + self.fast) / 2

    def moved(self, at: int, wander: float) -> Lines:
        """The same lines seen from another device time; later on, the slope may change by ``wander`` per ns."""
        by = float(at - self.at)
        if by <= 0.0:
            return Lines(at, self.lower + self.fast * by, self.upper + self.slow * by, self.slow, self.fast)
        turn = wander * by
        lower = self.lower + max(self.slow - turn / 2, -MAX_DRIFT) * by
        upper = self.upper + min(self.fast + turn / 2, MAX_DRIFT) * by
        return Lines(at, lower, upper, max(self.slow - turn, -MAX_DRIFT), min(self.fast + turn, MAX_DRIFT))


class Facts:
    """The tightest facts from one side, one per block of the cell's time.

    ``sign`` 1 stores the lowest offsets (facts from above), -1 the highest.
    """

    def __init__(self, sign: int) -> None:
        self._sign = sign
        self._closed: deque[Fact] = deque(maxlen=BLOCKS)
        self._open: Fact | None = None
        self._end = 0

    def add(self, when: int, fact: Fact, slope: float) -> bool:
        """Add a fact learned at cell time ``when``, store the block's tightest; return True if it closed a block."""
        best = self._open
        if best is None or when >= self._end:
            if best is not None:
                self._closed.append(best)
            self._open, self._end = fact, when + BLOCK
            return best is not None
        if self._sign * (fact[1] - best[1] - slope * (fact[0] - best[0])) < 0:
            self._open = fact
        return False

    def closed(self) -> Float:
        """Facts of the closed blocks, oldest first, (n, 2)."""
        return np.array(self._closed, dtype=np.float64).reshape(-1, 2)

    def all(self) -> Float:
        """Facts of all blocks, oldest first, the running block included, (n, 2)."""
        return np.array([*self._closed, *([self._open] if self._open else [])], dtype=np.float64).reshape(-1, 2)


def claims(above: Float, leeway: float, lines: Lines, wander: float) -> Float:
    """Facts from below, (m, 2), if of ``SPAN`` consecutive facts from above (n, 2) one is loose by ``leeway`` at most.

    It is unknown which one, so the weakest claim of all of them is used, once at the start of the span and once at
    its end; ``lines`` limits the slopes in between.
    """
    spans = sliding_window_view(above, min(SPAN, len(above)), axis=0)[::-1][:: SPAN // 2]
    at, offset = spans[:, 0], spans[:, 1]
    begin, end = at[:, :1], at[:, -1:]
    turn = wander * (lines.at - begin)
    fast = np.minimum(lines.fast + turn, MAX_DRIFT)
    slow = np.maximum(lines.slow - turn, -MAX_DRIFT)
    at_begin = (offset - fast * (at - begin)).min(axis=1) - leeway
    at_end = (offset + slow * (end - at)).min(axis=1) - leeway
    return np.concatenate([np.column_stack([begin, at_begin]), np.column_stack([end, at_end])])


def possible(above: Float, below: Float, wander: float) -> Lines | None:
    """All lines below the facts from above (n, 2) and above those from below (m, 2), seen from the newest fact.

    The slope may change by ``wander`` per ns, so a fact that is x ns old is loosened by wander x² / 2. A fact
    from above and an older one from below limit the slope from above, and so on: the extremes over all pairs
    are the exact extremes of this two-dimensional linear programme. ``None`` if no line is possible.
    """
    newest = max(above[:, 0].max(), below[:, 0].max())
    top_age, foot_age = newest - above[:, 0], newest - below[:, 0]
    top = above[:, 1] + _loosening(top_age, wander)
    foot = below[:, 1] - _loosening(foot_age, wander)
    older = foot_age[:, None] - top_age
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = (top - foot[:, None]) / older
    fast = min(MAX_DRIFT, float(slopes.min(initial=np.inf, where=older > 0)))
    slow = max(-MAX_DRIFT, float(slopes.max(initial=-np.inf, where=older < 0)))
    upper = float((top + fast * top_age).min())
    lower = float((foot + slow * foot_age).max())
    if slow > fast or lower > upper:
        return None
    return Lines(int(newest), lower, upper, slow, fast)


def _loosening(age: Float, wander: float) -> Float:
    loose: Float = np.minimum(wander / 2 * age, 2 * MAX_DRIFT) * age
    return loose
