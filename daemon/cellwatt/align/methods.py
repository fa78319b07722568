"""Values at grid points from samples: linear, average, hold.

Pure functions of the samples around each grid point, so that a value does not depend on how the stream is divided
into batches or the grid into blocks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, Nanoseconds, Qualities
from cellwatt.channel import Quality

_INTERPOLATED = np.uint8(Quality.INTERPOLATED)
_MISSING = np.uint8(Quality.MISSING)

_Index = NDArray[np.intp]
Columns = slice | _Index
"""Columns of the values: a slice of neighbouring ones, or an index of any."""


class Samples(NamedTuple):
    """Samples of a stream in order: ``time`` (n,) and ``bound`` (n,) ns, ``values`` (n, channels), ``quality`` (n,)."""

    time: Nanoseconds
    bound: Nanoseconds
    values: Float
    quality: Qualities


class Limits(NamedTuple):
    """Limits of the distance, ns, between the samples used: above ``plain`` a value counts as interpolated, above
    ``longest`` as missing.
    """

    plain: float
    longest: float


class Aligned(NamedTuple):
    """Values (m, channels) at m grid points; all channels share ``quality`` (m,) and ``bound`` (m,) ns."""

    values: Float
    quality: Qualities
    bound: Nanoseconds


def linear(samples: Samples, columns: Columns, grid: Nanoseconds, limits: Limits) -> Aligned:
    """Interpolate linearly between the neighbouring samples; a sample on a grid point is taken unchanged."""
    time, bound, values, quality = samples
    left, right, inside = _neighbours(time, grid)
    before, after = grid - time[left], time[right] - grid
    span = before + after
    weight = before / np.maximum(span, 1)
    low = values[left][:, columns]
    with np.errstate(invalid="ignore", over="ignore"):  # a device may send infinities
        result = low + weight[:, None] * (values[right][:, columns] - low)
    worst = _graded(np.maximum(quality[left], quality[right]), span, inside, limits)
    return Aligned(result, worst, np.maximum(bound[left], bound[right]) + np.minimum(before, after))


def hold(samples: Samples, columns: Columns, grid: Nanoseconds, limits: Limits) -> Aligned:
    """Take the last sample at or before the grid point; it counts as missing if it is older than ``limits.longest``."""
    last = samples.time.searchsorted(grid, side="right") - 1
    inside = last >= 0
    last = np.maximum(last, 0)
    age = grid - samples.time[last]
    return Aligned(
        samples.values[last][:, columns],
        _graded(samples.quality[last], age, inside, limits),
        samples.bound[last] + age,
    )


def average(samples: Samples, columns: Columns, grid: Nanoseconds, step: int, limits: Limits) -> Aligned:
    """Average the linear interpolation of the samples over one step around each of neighbouring grid points.

    Windows touch, so the averages times the step add up to the integral of the signal: energy is conserved.
    """
    time, bound, values, quality = samples
    edges = np.append(grid, grid[-1] + step) - step // 2
    first = time.searchsorted(edges[:-1], side="right") - 1
    last = time.searchsorted(edges[1:], side="left")
    inside = (first >= 0) & (last < len(time))
    known = np.flatnonzero(inside)
    result = np.zeros((len(grid), values[:1, columns].shape[1]))
    worst, width, span = np.zeros(len(grid), np.uint8), np.zeros(len(grid), np.int64), np.zeros(len(grid), np.int64)
    if len(known):
        whole = slice(known[0], known[-1] + 1)  # windows inside the samples' time are neighbours
        rows = slice(first[known[0]], last[known[-1]] + 1)
        result[whole] = _integrals(time[rows], values[rows, columns], edges[known[0] : known[-1] + 2]) / step
        pairs = np.column_stack([first[whole], last[whole]]).ravel()
        worst[whole] = np.maximum(np.maximum.reduceat(quality, pairs)[::2], quality[last[whole]])
        width[whole] = np.maximum(np.maximum.reduceat(bound, pairs)[::2], bound[last[whole]])
        span[whole] = np.maximum.reduceat(_steps(time), pairs)[::2]
    left, right, _ = _neighbours(time, grid)
    nearest = np.minimum(np.abs(grid - time[left]), np.abs(time[right] - grid))
    return Aligned(result, _graded(worst, span, inside, limits), width + nearest)


def _steps(time: Nanoseconds) -> Nanoseconds:
    """Time from each sample to the next, 0 for the last, (n,) ns."""
    steps = np.zeros_like(time)
    steps[:-1] = time[1:] - time[:-1]
    return steps


def _neighbours(time: Nanoseconds, grid: Nanoseconds) -> tuple[_Index, _Index, NDArray[np.bool_]]:
    """Indices of the samples before and after each grid point (equal if one is on it), and if both exist, (m,) each."""
    left = time.searchsorted(grid, side="right") - 1
    right = time.searchsorted(grid, side="left")
    inside = (left >= 0) & (right < len(time))
    return np.maximum(left, 0), np.minimum(right, len(time) - 1), inside


def _graded(quality: Qualities, span: Nanoseconds, inside: NDArray[np.bool_], limits: Limits) -> Qualities:
    """The samples' quality, lowered where they are far apart."""
    missing = ~(inside & (span <= limits.longest))
    return np.maximum(np.maximum(quality, (span > limits.plain) * _INTERPOLATED), missing * _MISSING)


def _integrals(time: Nanoseconds, values: Float, edges: Nanoseconds) -> Float:
    """Integral, value·ns (m, channels), between neighbouring edges (m + 1,) of the straight lines between samples."""
    left, right, _ = _neighbours(time, edges)
    before = edges - time[left]
    weight = before / np.maximum(time[right] - time[left], 1)
    at_edges = values[left] + weight[:, None] * (values[right] - values[left])
    begin, end = time.searchsorted(edges[0]), time.searchsorted(edges[-1])
    place = time.searchsorted(edges) - begin + np.arange(len(edges))
    is_edge = np.zeros(end - begin + len(edges), np.bool_)
    is_edge[place] = True
    when = np.empty(len(is_edge), np.int64)
    when[is_edge], when[~is_edge] = edges, time[begin:end]
    what = np.empty((len(is_edge), values.shape[1]))
    what[is_edge], what[~is_edge] = at_edges, values[begin:end]
    areas = (what[1:] + what[:-1]) * ((when[1:] - when[:-1]) / 2)[:, None]
    total: Float = np.add.reduceat(areas, place[:-1], axis=0)
    return total
