"""Lowest and highest value of channels in buckets of time. Pure.

A bucket of ``step`` ns with index i contains the samples from i · step to before (i + 1) · step, UTC ns; buckets
without samples are omitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

STEPS: Final = (200_000_000, 1_000_000_000, 10_000_000_000, 60_000_000_000, 600_000_000_000)
"""Steps of the levels, ns; each is a multiple of the one before it."""
LEAST: Final = 3
"""Smallest number of steps of a level per bucket of the answer: so rounding up loses few points."""
_LARGEST: Final = float(np.finfo(np.float32).max)

Index = NDArray[np.int64]
Values = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class Buckets:
    """Extremes ``low`` and ``high`` (channels, n) of n buckets, NaN if a channel has no sample; ``index`` (n,)
    increases.
    """

    index: Index
    low: Values
    high: Values

    def channel(self, row: int) -> Buckets:
        """The buckets of one channel."""
        return Buckets(self.index, self.low[row : row + 1], self.high[row : row + 1])

    def single(self) -> Buckets:
        """The buckets in single precision."""
        low, high = (np.clip(values, -_LARGEST, _LARGEST).astype(np.float32) for values in (self.low, self.high))
        return Buckets(self.index, low, high)


def of_samples(time: NDArray[np.int64], values: NDArray[np.float64], step: int) -> Buckets:
    """Buckets of samples ``values`` (n, channels) at ``time`` (n,), UTC ns, in any order; only finite values count."""
    columns = np.ascontiguousarray(np.where(np.isfinite(values), values, np.nan).T)
    return _merged(time // step, columns, columns)


def joined(parts: Sequence[Buckets]) -> Buckets:
    """Concatenate ``parts`` (at least one) of the same channels and step; buckets with the same index are merged."""
    low, high = (np.concatenate([getattr(part, name) for part in parts], axis=1) for name in ("low", "high"))
    return _merged(np.concatenate([part.index for part in parts]), low, high)


def coarser(buckets: Buckets, factor: int) -> Buckets:
    """Buckets with ``factor`` times the step."""
    return _merged(buckets.index // factor, buckets.low, buckets.high)


def levels(finest: Buckets) -> list[Buckets]:
    """Buckets of each of ``STEPS``, from those with the first step."""
    out = [finest]
    for before, step in pairwise(STEPS):
        out.append(coarser(out[-1], step // before))
    return out


def _merged(index: Index, low: Values, high: Values) -> Buckets:
    change = np.diff(index)
    if (change > 0).all():
        return Buckets(index, low, high)
    if (change < 0).any():
        order = np.argsort(index, kind="stable")
        index, low, high = index[order], low[:, order], high[:, order]
        change = np.diff(index)
    starts = np.concatenate([[0], np.flatnonzero(change) + 1])
    return Buckets(index[starts], np.fmin.reduceat(low, starts, axis=1), np.fmax.reduceat(high, starts, axis=1))


@dataclass(frozen=True, slots=True)
class Grid:
    """``count`` buckets of ``step`` ns, the first with index ``first``."""

    step: int
    first: int
    count: int

    @classmethod
    def over(cls, start: int, end: int, step: int) -> Grid:
        """The buckets that overlap the time from ``start`` to before ``end``, UTC ns."""
        first = start // step
        return cls(step, first, max(-(-end // step) - first, 1))

    @property
    def start(self) -> int:
        """UTC ns."""
        return self.first * self.step

    @property
    def end(self) -> int:
        """UTC ns."""
        return (self.first + self.count) * self.step

    def extremes(self, parts: Sequence[Buckets]) -> NDArray[np.float64]:
        """Lowest and highest values (2, count) of one channel's buckets of this step; NaN without samples."""
        out = np.full((2, self.count), np.nan)
        if parts:
            whole = joined(parts)
            first, last = np.searchsorted(whole.index, (self.first, self.first + self.count)).tolist()
            out[:, whole.index[first:last] - self.first] = whole.low[0, first:last], whole.high[0, first:last]
        return out


def chosen(start: int, end: int, points: int) -> tuple[int, Grid]:
    """The level to read (index in ``STEPS``), and the grid of at most ``points`` buckets to make from it."""
    grids = [fitting(start, end, points, step) for step in STEPS]
    level = max((n for n, grid in enumerate(grids) if grid.step >= LEAST * STEPS[n]), default=0)
    return level, grids[level]


def span_of(start_ms: float, end_ms: float) -> tuple[int, int]:
    """A span in UTC ns, at least 1 ns long."""
    return round(start_ms * 1e6), max(round(end_ms * 1e6), round(start_ms * 1e6) + 1)


def fitting(start: int, end: int, points: int, unit: int) -> Grid:
    """A grid of at most ``points`` (2 or more) buckets whose step is a multiple of ``unit`` ns; nearly the finest."""
    grids = (Grid.over(start, end, max(-(-(end - start) // (n * unit)), 1) * unit) for n in (points, points - 1))
    return next(grid for grid in grids if grid.count <= points)
