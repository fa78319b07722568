"""Lowest and highest value of channels in buckets of time. Pure.

A bucket of ``step`` ns with index i holds the samples from i · step to before (i + 1) · step, UTC ns; buckets without
samples are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import CellwattError

STEPS: Final = (200_000_000, 1_000_000_000, 10_000_000_000, 60_000_000_000, 600_000_000_000)
"""Steps of the levels, ns; each is a multiple of the one before."""
LEAST: Final = 3
"""Steps of a level that a bucket of the answer holds at least: so few are lost by rounding up."""
_LARGEST: Final = float(np.finfo(np.float32).max)

Index = NDArray[np.int64]
Values = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Buckets:
    """Extremes ``low`` and ``high`` (channels, n) of n buckets, NaN where a channel has no sample; ``index`` (n,)
    rises.
    """

    index: Index
    low: Values
    high: Values

    def __len__(self) -> int:
        return len(self.index)

    @property
    def size(self) -> int:
        """Bytes."""
        return self.index.nbytes + self.low.nbytes + self.high.nbytes


def nothing(channels: int) -> Buckets:
    """No buckets."""
    empty = np.empty((channels, 0), np.float32)
    return Buckets(np.empty(0, np.int64), empty, empty)


def of_samples(time: NDArray[np.int64], values: NDArray[np.float64], step: int) -> Buckets:
    """Buckets of samples ``values`` (n, channels) at ``time`` (n,) UTC ns, in any order; NaN and infinities are none.

    Extremes are the nearest single-precision numbers.
    """
    columns = np.ascontiguousarray(values.T)
    columns = np.where(np.isfinite(columns), np.clip(columns, -_LARGEST, _LARGEST), np.nan)
    return _merged(np.asarray(time, np.int64) // step, columns.astype(np.float32))


def joined(parts: Sequence[Buckets], channels: int) -> Buckets:
    """Buckets of the same channels and step as one; those with the same index become one."""
    if not parts:
        return nothing(channels)
    index = np.concatenate([part.index for part in parts])
    low = np.concatenate([part.low for part in parts], axis=1)
    high = np.concatenate([part.high for part in parts], axis=1)
    return _merged(index, low, high)


def coarser(buckets: Buckets, factor: int) -> Buckets:
    """Buckets of ``factor`` times the step."""
    return _merged(buckets.index // factor, buckets.low, buckets.high)


def levels(finest: Buckets) -> list[Buckets]:
    """Buckets of each of ``STEPS``, from those of the first."""
    out = [finest]
    for before, step in pairwise(STEPS):
        out.append(coarser(out[-1], step // before))
    return out


def _merged(index: Index, low: Values, high: Values | None = None) -> Buckets:
    high = low if high is None else high
    if not len(index):
        return Buckets(index, low, high)
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
        """The buckets that hold any of the time from ``start`` to before ``end`` UTC ns."""
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


def chosen(start: int, end: int, points: int) -> tuple[int, Grid]:
    """The level (place in ``STEPS``) to read and the grid of at most ``points`` buckets to make of it."""
    for level in reversed(range(len(STEPS))):
        grid = fitting(start, end, points, STEPS[level])
        if level == 0 or grid.step >= LEAST * STEPS[level]:
            return level, grid
    raise AssertionError("the first level always serves")


def span_of(start_ms: float, end_ms: float) -> tuple[int, int]:
    """A span in UTC ns. Raises ``CellwattError`` for one that is none."""
    if not (math.isfinite(start_ms) and math.isfinite(end_ms) and 0 <= start_ms < end_ms < 2**62 / 1e6):
        raise CellwattError(f"no span from {start_ms:g} to {end_ms:g} ms: it must end after it begins")
    return round(start_ms * 1e6), max(round(end_ms * 1e6), round(start_ms * 1e6) + 1)


def fitting(start: int, end: int, points: int, unit: int) -> Grid:
    """A grid of at most ``points`` (2 or more) buckets, nearly the finest, whose step is a multiple of ``unit`` ns."""
    grids = (Grid.over(start, end, max(-(-(end - start) // (n * unit)), 1) * unit) for n in (points, points - 1))
    return next(grid for grid in grids if grid.count <= points)


class Canvas:
    """Extremes of channels on a grid, put together from many recordings."""

    def __init__(self, grid: Grid, channels: int) -> None:
        self.grid = grid
        self.low = np.full((channels, grid.count), np.nan, np.float64)
        self.high = self.low.copy()

    def add(self, row: int, step: int, index: Index, low: NDArray[np.floating], high: NDArray[np.floating]) -> None:
        """Put buckets of ``step`` ns of one channel, in order, into row ``row``; those beside the grid are left out.

        The grid's step is a multiple of ``step``.
        """
        at = index // (self.grid.step // step) - self.grid.first
        first, last = np.searchsorted(at, (0, self.grid.count)).tolist()
        if first >= last:
            return
        at, low, high = at[first:last], low[first:last], high[first:last]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(at)) + 1])
        places = at[starts]
        self.low[row, places] = np.fmin(self.low[row, places], np.fmin.reduceat(low, starts))
        self.high[row, places] = np.fmax(self.high[row, places], np.fmax.reduceat(high, starts))

    def add_samples(self, row: int, time: Index, values: NDArray[np.float64]) -> None:
        """Put samples of one channel, in order of time (UTC ns), into row ``row``; NaN and infinities are none."""
        known = np.isfinite(values)
        self.add(row, self.grid.step, time[known] // self.grid.step, values[known], values[known])
