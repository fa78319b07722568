"""Compares slopes of joints with those of their kind and of their own arm.

Joints of an arm share its hall and its lubricant. If these change, all its joints change without wear: the common
slope of an arm's other joints is subtracted from each joint, to the extent that arms differ in it (best linear
prediction; Robinson, Statistical Science 6, 1991, 15).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from cellwatt.arrays import Float
from cellwatt_plugins.fleet.adjusted import Course
from cellwatt_plugins.fleet.courses import CellJoint
from cellwatt_plugins.fleet.kinds import FEWEST, MIDDLE, WORTH, moderated, spread_of, summed
from cellwatt_plugins.fleet.trend import Line, Step, line

JOINTS: Final = 3
"""Fewest joints of an arm from which the difference between arms is estimated."""
MEDIAN: Final = float(np.pi / 2)
"""Variance of a median relative to that of the mean."""
ODD: Final = 3.0
"""Largest common change of an arm's joints attributed to the arm, in standard deviations between arms."""


@dataclass(frozen=True)
class Trend:
    """A linear trend of a joint (or of the whole arm, for energy) relative to its kind.

    ``slope`` per week is relative to the median of the kind and the common slope of the arm's other joints.
    """

    place: CellJoint
    line: Line
    slope: float
    error: float
    free: float
    chance: float

    @property
    def span(self) -> int:
        """Weeks from the first to the last week."""
        return self.line.last - self.line.first

    def interval(self) -> tuple[float, float]:
        """Return the ends of the slope's 95 % confidence interval."""
        wide = float(stdtrit(self.free, 0.975)) * self.error
        return self.slope - wide, self.slope + wide


@dataclass(frozen=True)
class _Slopes:
    """Slopes of K joints relative to their kind, and ``squares``, their variances by the weeks' scatter; (K,) each."""

    cells: NDArray[np.str_]
    values: Float
    squares: Float


@dataclass(frozen=True)
class _Medians:
    """Medians of the slopes of M groups of joints, with the medians of their variances, ``squares``; (M,) each.

    ``shares`` is the variance of each median relative to that of one joint; infinite for an empty group.
    """

    values: Float
    shares: Float
    squares: Float

    @classmethod
    def of(cls, slopes: _Slopes, groups: Sequence[NDArray[np.bool_]]) -> _Medians:
        """Return the medians of groups of joints."""
        rows = [
            (np.median(slopes.values[each]), MEDIAN / each.sum(), np.median(slopes.squares[each]))
            if each.any()
            else (0.0, np.inf, 1.0)
            for each in groups
        ]
        return cls(*np.array(rows).T)

    def noise(self, own: float) -> Float:
        """Return the variances of the medians if joints differ by ``own`` beyond the scatter of their weeks."""
        return np.asarray(self.shares * (self.squares + own**2))


def trends_of(
    own: Mapping[CellJoint, Course], steps: Mapping[CellJoint, Sequence[Step]], rho: float
) -> dict[CellJoint, Trend]:
    """Return the trends of a kind's joints relative to each other; errors include the spread of healthy joints."""
    lines = {place: found for place, course in own.items() if (found := line(course, rho, steps[place])) is not None}
    cells = np.array([place.cell for place in lines])
    squares, free = _errors(own, lines)
    if len(set(cells)) < FEWEST:
        return _trends(lines, np.array([each.slope for each in lines.values()]), squares, free)
    middle = {
        joint: float(np.median([each.slope for place, each in lines.items() if place.joint == joint]))
        for joint in {place.joint for place in lines}
    }
    slopes = _Slopes(cells, np.array([each.slope - middle[p.joint] for p, each in lines.items()]), squares)
    place = np.arange(len(cells))
    others = _Medians.of(slopes, [(cells == cell) & (place != i) for i, cell in enumerate(cells)])
    joints = _joints_apart(slopes, others)
    arms = _arms_apart(slopes, joints)
    noise = others.noise(joints)
    known = arms**2 / (arms**2 + noise) if arms > 0 else np.zeros(len(noise))
    limit = ODD * arms / np.sqrt(np.where(known > 0, known, 1.0))
    by_arm = known * np.clip(others.values, -limit, limit)
    beside = len(set(cells)) - 1.0  # joints of one arm share its hall: arms count, not joints
    parts: list[tuple[Float, Float | float]] = [
        (squares, free),
        (np.full(len(lines), joints**2), max(WORTH * beside, 1.0)),
        (arms**2 * (1 - known), beside),
    ]
    return _trends(lines, slopes.values - by_arm, *summed(parts))


def _trends(lines: Mapping[CellJoint, Line], slopes: Float, squares: Float, free: Float) -> dict[CellJoint, Trend]:
    errors = np.sqrt(squares)
    chances = np.asarray(2 * stdtr(free, -np.abs(slopes) / errors))
    rows = zip(lines.items(), slopes.tolist(), errors.tolist(), free.tolist(), chances.tolist(), strict=True)
    return {place: Trend(place, each, *row) for (place, each), *row in rows}


def _errors(own: Mapping[CellJoint, Course], lines: Mapping[CellJoint, Line]) -> tuple[Float, Float]:
    """Variances of slopes and their degrees of freedom; for lines of equal length they are similar in all arms."""
    length = np.array([float(np.sum(_about(own[place].weeks, each) ** 2)) for place, each in lines.items()])
    squares = np.array([each.error**2 for each in lines.values()])
    squares, free = moderated(squares * length, np.array([each.free for each in lines.values()]))
    return squares / length, free


def _about(weeks: NDArray[np.intp], each: Line) -> Float:
    inside = weeks[weeks >= each.first].astype(np.float64)
    return np.asarray(inside - inside.mean())


def _joints_apart(slopes: _Slopes, others: _Medians) -> float:
    """Standard deviation between joints of healthy arms beyond the scatter of their weeks."""
    shares = np.where(np.isfinite(others.shares), others.shares, 0.0)
    squares = (slopes.squares + shares * others.squares) / (1 + shares)
    return spread_of((slopes.values - others.values) / np.sqrt(1 + shares), np.sqrt(squares))


def _arms_apart(slopes: _Slopes, joints: float) -> float:
    """Standard deviation between healthy arms of their joints' common slope; 0 if there are too few arms."""
    every = [slopes.cells == cell for cell in np.unique(slopes.cells)]
    known = [arm for arm in every if arm.sum() >= JOINTS]
    if len(known) < FEWEST:
        return 0.0
    arms = _Medians.of(slopes, known)
    limit = ODD * float(np.median(np.abs(arms.values))) / MIDDLE
    beyond = float(np.mean(np.clip(arms.values, -limit, limit) ** 2 - arms.noise(joints)))
    return float(np.sqrt(max(beyond, 0.0)))
