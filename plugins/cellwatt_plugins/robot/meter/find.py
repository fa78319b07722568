"""Finds a meter's window and delay: where motion and torques explain most of what it shows."""

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
"""Windows that are tried, in intervals from one value to the next."""
LONGEST: Final = 2.0
"""s: no meter averages over more."""
LATEST: Final = 1.0
"""s: nor is one later, where its values are in the robot's own recording."""
FINEST: Final = 0.01
"""s from one delay to the next, at least."""
STEPS: Final = 12
STILL: Final = 1e-5
"""s by which the last steps change window and delay."""
RIDGE: Final = 1e-10
SMOOTH: Final = 0.08
"""s over which instruments are averaged."""
USUAL: Final = 0.05
"""Share of the interval by which a usual window differs from it (one sigma) …"""
AGAINST: Final = 3.0
"""… unless the data say so by this many."""
LIKE: Final = 2.0
"""s within which what is left may be alike: so much is one draw."""
MOST: Final = 1000
"""Values that the grid is searched with."""
OWN: Final = 0.055
"""s: window whose smoothing an arm's bus may have of its own (one sigma), or the kinds may lack."""
ALIKE: Final = 0.25
"""Share of the values' variance that the motion must explain."""
LASTS: Final = 0.7
"""s that an arm speeds up or slows down: what the kinds lack of the power may look like a window so long."""
FEWEST: Final = 3.0
"""Values for each unknown, at least."""


@dataclass(frozen=True)
class _Sums:
    """Running sums of the kinds over all segments, one behind the other."""

    sums: Float
    first: NDArray[np.intp]
    """Row at which each segment begins."""
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
        """(M, k) over windows of segments (M,); beyond a segment its ends are held."""
        return (self._until(segment, end) - self._until(segment, start)) * (self.step / (end - start))[:, None]

    def inside(self, segment: NDArray[np.intp], start: Float, end: Float) -> NDArray[np.bool_]:
        last = self.start[segment] + self.rows[segment] * self.step
        return np.asarray((start >= self.start[segment]) & (end <= last))

    def _until(self, segment: NDArray[np.intp], time: Float) -> Float:
        place = (time - self.start[segment]) / self.step
        low = np.clip(np.floor(place), 0, self.rows[segment] - 1).astype(np.intp)
        share, low = (place - low)[:, None], low + self.first[segment]
        return np.asarray((1 - share) * self.sums[low] + share * self.sums[low + 1])


@dataclass(frozen=True)
class _Shown:
    """All values with the segment that each belongs to."""

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
    """The meter of all segments; None where they are too few, all the same, or do not follow the motion.

    Its values are taken as means of a sum of the kinds, each with a weight of its own, and a level: window and delay
    are where least is left, first on a grid between ``earliest`` and ``latest``, then by Gauss-Newton. Their standard
    deviations take what is left within ``LIKE`` s as one draw. ``usual`` s is the window that its maker tells; left
    out: as long as from one value to the next.
    """
    shown, sums = _Shown.of(readings), _Sums.of(courses)
    # Beyond a segment its ends are held: recordings begin and end at rest, and short ones would lose too much.
    kept = np.arange(len(shown.time)) % max(1, -(-len(shown.time) // MOST)) == 0
    value = shown.value[kept]
    if len(shown.time) < FEWEST * (sums.sums.shape[1] + 3) or not np.ptp(value):
        return None
    windows = [w for share in WINDOWS if sums.step <= (w := share * shown.interval) <= LONGEST] or [shown.interval]
    delays = np.arange(earliest, latest, max(shown.interval / 5, FINEST))
    window, late = min(product(windows, delays), key=lambda wd: _left(shown, sums, kept, *wd))
    free = max(1, len(value) - sums.sums.shape[1] - 3)
    unexplained = _left(shown, sums, kept, window, float(late)) / free / float(np.var(value))
    if not unexplained < 1 - ALIKE:
        return None
    usual = usual or shown.interval
    # The wider a window, the less noise of torques and velocities is left in its mean: least squares would find windows
    # too wide. So every other row is fitted with those between, smoothed, as its instruments: what is wrong with one
    # half is not wrong with the other.
    halves = [_Sums.of([Course(c.time[i::2], c.kinds[i::2]) for c in courses]) for i in (0, 1)]
    return _refined(shown, halves, window, float(late), usual, unexplained)


def _design(shown: _Shown, sums: _Sums, kept: NDArray[np.bool_], window: float, ago: float) -> Float:
    """Kinds (M, k + 1) over windows whose middle was ``ago`` s before a value came, and a level."""
    # A row holds for a step: it has been averaged over that already.
    own = float(np.sqrt(max(window**2 - sums.step**2, (sums.step / 10) ** 2)))
    middle = shown.time[kept] - ago
    means = sums.means(shown.segment[kept], middle - own / 2, middle + own / 2)
    return np.column_stack([means, np.ones(len(means))])


def _left(shown: _Shown, sums: _Sums, kept: NDArray[np.bool_], window: float, late: float) -> float:
    design, value = _design(shown, sums, kept, window, late + window / 2), shown.value[kept]
    return float(np.sum((value - design @ _solved(design, design, value)) ** 2))


def _solved(instruments: Float, design: Float, value: Float) -> Float:
    gram = instruments.T @ design
    return np.asarray(np.linalg.lstsq(gram, instruments.T @ value, rcond=RIDGE)[0])


def _refined(
    shown: _Shown, sides: Sequence[_Sums], window: float, late: float, usual: float, unexplained: float
) -> Meter:
    """Gauss-Newton on the middle and the width of the window, and all weights; the ``sides`` fit each other."""
    step, ago = sides[0].step, late + window / 2
    for _ in range(STEPS):
        middle = shown.time - ago
        begin, end = middle - window / 2, middle + window / 2
        kept = np.all([side.inside(shown.segment, begin, end) for side in sides], axis=0)
        value, wider = np.tile(shown.value[kept], 2), float(np.hypot(window, SMOOTH))
        design = np.concatenate([_design(shown, side, kept, window, ago) for side in sides])
        smooth = np.concatenate([_design(shown, side, kept, wider, ago) for side in sides[::-1]])
        weights = _solved(smooth, design, value)
        slopes = np.concatenate([_slopes(shown, side, kept, window, ago, weights) for side in sides])
        instruments = np.concatenate([_slopes(shown, side, kept, wider, ago, weights) for side in sides[::-1]])
        change = _solved(instruments, slopes, value)
        moved = np.clip(change[:2], -shown.interval / 4, shown.interval / 4)
        before = window, ago
        window, ago = float(np.clip(window + moved[0], step / 2, LONGEST)), ago + float(moved[1])
        if abs(window - before[0]) + abs(ago - before[1]) < STILL:
            break
    left = (value - slopes @ change).reshape(2, -1).mean(axis=0)
    pulls = instruments.reshape(2, len(left), -1).mean(axis=0)
    covariance = _covariance(pulls, instruments.T @ slopes / 2, left, shown.segment[kept], shown.time[kept])
    believed = _believed(window, ago, covariance, usual, OWN**2 + unexplained * LASTS**2)
    return replace(believed, interval=shown.interval, unexplained=unexplained)


def _slopes(shown: _Shown, sums: _Sums, kept: NDArray[np.bool_], window: float, ago: float, weights: Float) -> Float:
    """Derivatives of the values by the window's width and middle, then by all weights: (M, 2 + k)."""
    h = max(sums.step, window / 10) / 2

    def at(window: float, ago: float) -> Float:
        return np.asarray(_design(shown, sums, kept, window, ago) @ weights)

    low = max(window - h, h / 10)
    by_window = (at(window + h, ago) - at(low, ago)) / (window + h - low)
    by_ago = (at(window, ago + h) - at(window, ago - h)) / (2 * h)
    return np.column_stack([by_window, by_ago, _design(shown, sums, kept, window, ago)])


def _covariance(pulls: Float, gram: Float, left: Float, segment: NDArray[np.intp], time: Float) -> Float:
    """Of window and middle (2, 2): what is left in a stretch of ``LIKE`` s is one draw."""
    inverse = np.linalg.pinv(gram)[:2]
    stretch = np.unique(np.column_stack([segment, np.floor(time / LIKE)]), axis=0, return_inverse=True)[1].ravel()
    each = np.zeros((stretch.max() + 1, pulls.shape[1]))
    np.add.at(each, stretch, pulls * left[:, None])
    free = max(1, len(left) - pulls.shape[1])
    together = inverse @ (each.T @ each) @ inverse.T * len(left) / free
    alone = np.sum(left**2) / free * inverse @ (pulls.T @ pulls) @ inverse.T
    # The first is too narrow where stretches are few; noise without memory is the least that there is.
    return np.asarray(together if np.trace(together) > np.trace(alone) else alone)


def _believed(window: float, ago: float, covariance: Float, told: float, own: float) -> Meter:
    """With the window that is told, or usual. It is not believed where the data are against it.

    In squares: what smooths the power beside the meter adds to the window's square, up to ``own`` s² (one sigma).
    """
    square, usual = window**2, told**2
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
    return Meter(window, ago - window / 2, told, min(spreads[0], window), spreads[1])
