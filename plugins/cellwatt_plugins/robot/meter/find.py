"""Finds a meter's window and delay: those with which motion and torques explain most of the meter's values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.meter.kinds import Course
from cellwatt_plugins.robot.meter.model import Meter, Readings

WINDOWS: Final = (0.05, 0.25, 0.5, 0.75, 1.0, 1.4, 2.0, 3.0)
"""Windows that are tried, in intervals between values."""
LONGEST: Final = 2.0
"""Longest window in s of a meter."""
LATEST: Final = 1.0
"""Largest delay in s of a meter whose values are in the robot's own recording."""
FINEST: Final = 0.01
"""Smallest step in s between delays that are tried."""
STEPS: Final = 12
STILL: Final = 1e-5
"""Change of window and delay in s below which the steps end."""
RIDGE: Final = 1e-10
SMOOTH: Final = 0.08
"""Time in s over which instruments are averaged."""
USUAL: Final = 0.05
"""Standard deviation of a window from the usual one, as a share of the interval …"""
AGAINST: Final = 3.0
"""… which is assumed unless the data differ from it by this many standard deviations."""
LIKE: Final = 2.0
"""Time in s within which residuals may be correlated: they count as one draw."""
MOST: Final = 1000
"""Largest number of values in the search on the grid."""
OWN: Final = 0.055
"""Window in s that an arm's bus smooths the power with, or that the kinds lack (one standard deviation)."""
ALIKE: Final = 0.25
"""Smallest share of the values' variance that the motion must explain."""
LASTS: Final = 0.7
"""Time in s for which an arm accelerates: power that the kinds lack may look like a window of this length."""
FEWEST: Final = 3.0
"""Fewest values for each unknown."""


@dataclass(frozen=True)
class _Sums:
    """Running sums of the kinds over all segments, concatenated."""

    sums: Float
    first: NDArray[np.intp]
    """First row of each segment."""
    rows: NDArray[np.intp]
    start: Float
    """s, half a row before each segment's first row."""
    step: float

    @classmethod
    def of(cls, courses: Sequence[Course]) -> _Sums:
        rows = np.array([len(course.time) for course in courses], np.intp)
        step = float(np.median(np.concatenate([np.diff(course.time) for course in courses])))
        kinds = np.concatenate([course.kinds for course in courses])
        kinds = kinds / np.maximum(np.sqrt(np.mean(kinds**2, axis=0)), 1e-12)
        sums = np.concatenate([np.zeros((1, kinds.shape[1])), np.cumsum(kinds, axis=0)])
        start = np.array([course.time[0] for course in courses]) - step / 2
        return cls(sums, np.cumsum(rows) - rows, rows, start, step)

    def means(self, segment: NDArray[np.intp], start: Float, end: Float) -> Float:
        """Means (M, k) over windows in segments (M,); beyond a segment its end values are held."""
        return (self._until(segment, end) - self._until(segment, start)) * (self.step / (end - start))[:, None]

    def inside(self, segment: NDArray[np.intp], start: Float, end: Float) -> NDArray[np.bool_]:
        last = self.start[segment] + self.rows[segment] * self.step
        return np.asarray((start >= self.start[segment]) & (end <= last))

    def _until(self, segment: NDArray[np.intp], time: Float) -> Float:
        position = (time - self.start[segment]) / self.step
        low = np.clip(np.floor(position), 0, self.rows[segment] - 1).astype(np.intp)
        share, low = (position - low)[:, None], low + self.first[segment]
        return np.asarray((1 - share) * self.sums[low] + share * self.sums[low + 1])


@dataclass(frozen=True)
class _Shown:
    """All values, with the segment of each."""

    segment: NDArray[np.intp]
    time: Float
    value: Float
    interval: float

    @classmethod
    def of(cls, readings: Sequence[Readings]) -> _Shown:
        segment = np.repeat(np.arange(len(readings)), [len(r.time) for r in readings])
        time, value = (np.concatenate([getattr(r, name) for r in readings]) for name in ("time", "value"))
        return cls(segment, time, value, readings[0].interval)


def find(
    readings: Sequence[Readings],
    courses: Sequence[Course],
    latest: float = LATEST,
    earliest: float = 0.0,
    usual: float | None = None,
) -> Meter | None:
    """The meter of all segments; None if their values are too few, constant, or do not follow the motion.

    Its values are modelled as means of a weighted sum of the kinds and a constant: window and delay minimise the
    residual, first on a grid between ``earliest`` and ``latest``, then by Gauss-Newton. Their standard deviations count
    the residuals within ``LIKE`` s as one draw. ``usual`` is the declared window in s; if left out, the interval
    between values.
    """
    shown, sums = _Shown.of(readings), _Sums.of(courses)
    # Beyond a segment its end values are held: recordings begin and end at rest, and short ones would lose too much.
    used = np.arange(len(shown.time)) % max(1, -(-len(shown.time) // MOST)) == 0
    value = shown.value[used]
    if len(shown.time) < FEWEST * (sums.sums.shape[1] + 3) or not np.ptp(value):
        return None
    windows = [w for share in WINDOWS if sums.step <= (w := share * shown.interval) <= LONGEST] or [shown.interval]
    delays = np.arange(earliest, latest, max(shown.interval / 5, FINEST))
    window, late = min(product(windows, delays), key=lambda wd: _misfit(shown, sums, used, *wd))
    free = max(1, len(value) - sums.sums.shape[1] - 3)
    unexplained = _misfit(shown, sums, used, window, float(late)) / free / float(np.var(value))
    if not unexplained < 1 - ALIKE:
        return None
    usual = usual or shown.interval
    # The wider a window, the less noise of torques and velocities remains in its mean: least squares would find windows
    # too wide. So each half of the rows is fitted with the other half, smoothed, as its instruments: the errors of the
    # two halves are independent.
    halves = [_Sums.of([Course(c.time[i::2], c.kinds[i::2]) for c in courses]) for i in (0, 1)]
    return _refined(shown, halves, window, float(late), usual, unexplained)


def _design(shown: _Shown, sums: _Sums, used: NDArray[np.bool_], window: float, ago: float) -> Float:
    """Means of the kinds and a constant (M, k + 1) over windows whose middle was ``ago`` s before a value came."""
    # A row is already an average over one step.
    own = float(np.sqrt(max(window**2 - sums.step**2, (sums.step / 10) ** 2)))
    middle = shown.time[used] - ago
    means = sums.means(shown.segment[used], middle - own / 2, middle + own / 2)
    return np.column_stack([means, np.ones(len(means))])


def _misfit(shown: _Shown, sums: _Sums, used: NDArray[np.bool_], window: float, late: float) -> float:
    design, value = _design(shown, sums, used, window, late + window / 2), shown.value[used]
    return float(np.sum((value - design @ _solved(design, design, value)) ** 2))


def _solved(instruments: Float, design: Float, value: Float) -> Float:
    gram = instruments.T @ design
    return np.asarray(np.linalg.lstsq(gram, instruments.T @ value, rcond=RIDGE)[0])


def _refined(
    shown: _Shown, sides: Sequence[_Sums], window: float, late: float, usual: float, unexplained: float
) -> Meter | None:
    """Gauss-Newton on middle and width of the window, and all weights; the ``sides`` are each other's instruments.

    None if the windows of too few values lie within their segments.
    """
    step, ago = sides[0].step, late + window / 2
    for _ in range(STEPS):
        middle = shown.time - ago
        begin, end = middle - window / 2, middle + window / 2
        used = np.all([side.inside(shown.segment, begin, end) for side in sides], axis=0)
        if used.sum() < sides[0].sums.shape[1] + 3:
            return None
        value, wider = np.tile(shown.value[used], 2), float(np.hypot(window, SMOOTH))
        design = np.concatenate([_design(shown, side, used, window, ago) for side in sides])
        smooth = np.concatenate([_design(shown, side, used, wider, ago) for side in sides[::-1]])
        weights = _solved(smooth, design, value)
        slopes = np.concatenate([_slopes(shown, side, used, window, ago, weights) for side in sides])
        instruments = np.concatenate([_slopes(shown, side, used, wider, ago, weights) for side in sides[::-1]])
        change = _solved(instruments, slopes, value)
        moved = np.clip(change[:2], -shown.interval / 4, shown.interval / 4)
        before = window, ago
        window, ago = float(np.clip(window + moved[0], step / 2, LONGEST)), ago + float(moved[1])
        if abs(window - before[0]) + abs(ago - before[1]) < STILL:
            break
    residual = (value - slopes @ change).reshape(2, -1).mean(axis=0)
    pulls = instruments.reshape(2, len(residual), -1).mean(axis=0)
    covariance = _covariance(pulls, instruments.T @ slopes / 2, residual, shown.segment[used], shown.time[used])
    believed = _believed(window, ago, covariance, usual, OWN**2 + unexplained * LASTS**2)
    return replace(believed, interval=shown.interval, unexplained=unexplained)


def _slopes(shown: _Shown, sums: _Sums, used: NDArray[np.bool_], window: float, ago: float, weights: Float) -> Float:
    """Derivatives of the values by the window's width and middle, then by all weights: (M, 2 + k)."""
    h = max(sums.step, window / 10) / 2

    def at(window: float, ago: float) -> Float:
        return np.asarray(_design(shown, sums, used, window, ago) @ weights)

    low = max(window - h, h / 10)
    by_window = (at(window + h, ago) - at(low, ago)) / (window + h - low)
    by_ago = (at(window, ago + h) - at(window, ago - h)) / (2 * h)
    return np.column_stack([by_window, by_ago, _design(shown, sums, used, window, ago)])


def _covariance(pulls: Float, gram: Float, residual: Float, segment: NDArray[np.intp], time: Float) -> Float:
    """Covariance (2, 2) of window and middle: the residuals in a stretch of ``LIKE`` s are one draw."""
    inverse = np.linalg.pinv(gram)[:2]
    stretch = np.unique(np.column_stack([segment, np.floor(time / LIKE)]), axis=0, return_inverse=True)[1].ravel()
    each = np.zeros((stretch.max() + 1, pulls.shape[1]))
    np.add.at(each, stretch, pulls * residual[:, None])
    free = max(1, len(residual) - pulls.shape[1])
    together = inverse @ (each.T @ each) @ inverse.T * len(residual) / free
    alone = np.sum(residual**2) / free * inverse @ (pulls.T @ pulls) @ inverse.T
    # The first is too small if stretches are few; noise without memory is the least possible.
    return np.asarray(together if np.trace(together) > np.trace(alone) else alone)


def _believed(window: float, ago: float, covariance: Float, declared: float, own: float) -> Meter:
    """The meter with its ``declared`` or usual window, unless the data contradict that window.

    In squares: smoothing of the power beside the meter adds to the window's square, up to ``own`` s² (one sigma).
    """
    square, usual = window**2, declared**2
    to_square = np.array([[2 * window, 0.0], [0.0, 1.0]])
    known = to_square @ covariance @ to_square + np.array([[own**2, 0.0], [0.0, 0.0]])
    spread = (2 * USUAL * usual) ** 2 + known[0, 0]
    if abs(usual - square) < AGAINST * np.sqrt(spread):
        gain = known[0] / spread
        square, ago = square + float(gain[0]) * (usual - square), ago + float(gain[1]) * (usual - square)
        known = known - np.outer(gain, known[0])
    window = float(np.sqrt(square))
    by_square = np.array([1 / (2 * window), 0.0])
    by_late = np.array([-1 / (4 * window), 1.0])
    spreads = [float(np.sqrt(by @ known @ by)) for by in (by_square, by_late)]
    return Meter(window, ago - window / 2, declared, min(spreads[0], window), spreads[1])
