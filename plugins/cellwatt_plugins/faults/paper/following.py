"""Finds the cycles of a running arm and judges each interval as soon as it is over."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwatt.arrays import joined
from cellwatt.results import Interval
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.paper.codes import Residual
from cellwatt_plugins.faults.paper.course import FAR, Course
from cellwatt_plugins.faults.paper.expected import Readings
from cellwatt_plugins.faults.paper.judging import IntervalVerdict, judge_interval
from cellwatt_plugins.faults.trace import Trace

AFTER = 0.12
"""Time after its end at which an interval is judged, s."""
BEFORE = 0.2
"""Rest, s, that must have been recorded before a cycle; otherwise it may have begun earlier and is not judged."""
GAP = 0.1
"""Longest hole in the frames of a judged cycle, s."""
MARGIN = 2 * 10**9
"""Time before the running cycle for which frames are stored, ns."""


@dataclass(frozen=True)
class CycleSoFar:
    """A cycle from ``start`` (ns) with the verdicts on its intervals so far; ``over`` after its last interval."""

    course: Course
    start: int
    verdicts: tuple[IntervalVerdict, ...]
    over: bool


@dataclass
class CyclesSeen:
    """Follows the cycles of one arm from its frames and intervals, block by block.

    ``latest`` is the number of the latest moving interval.
    """

    courses: Sequence[Course]
    tolerance: Tolerance
    joints: int
    residual: Residual = "samples"
    latest: int | None = None
    _start: int | None = None
    _course: Course | None = None
    _possible: Sequence[Course] = ()
    _verdicts: list[IntervalVerdict] = field(default_factory=list)
    _free_from: int = 0

    def __post_init__(self) -> None:
        self._trace = Trace.empty(self.joints)

    def feed(self, block: Trace, intervals: Iterable[Interval]) -> Iterator[CycleSoFar]:
        """Yield the running cycle after each of its finished intervals; ``intervals`` are those of this block."""
        self._trace = joined([self._trace, block])
        for interval in intervals:
            # An interval is reported open, ending at the frame that confirmed it, and closed later.
            if interval.moving and not interval.closed:
                yield from self._judge(self._trace.between(0, interval.end))
                self.latest = interval.number
                self._see(interval)
        yield from self._judge(self._trace)
        if len(self._trace):
            newest = int(self._trace.time[-1])
            self._trace = self._trace.between((self._start or newest) - MARGIN, newest)

    def _see(self, interval: Interval) -> None:
        """Start a cycle if a motion that has begun may be the first of a course."""
        if self._start is not None or interval.start < self._free_from or not interval.complete:
            return
        self._possible = [course for course in self.courses if course.begins_with(interval)]
        if self._possible:
            self._start = interval.start

    def _judge(self, trace: Trace) -> Iterator[CycleSoFar]:
        """Yield the running cycle after each interval that has ended within ``trace``."""
        while (start := self._start) is not None and len(trace):
            now = (int(trace.time[-1]) - start) * 1e-9
            if not self._decided(trace, now) or self._course is None:
                break
            expected = self._course.intervals[len(self._verdicts)]
            if now < expected.end + AFTER:
                break
            readings, end = _readings(trace, start), start + round(expected.end * 1e9)
            if not _known(readings, expected.start, expected.end):
                self._end(end)
                break
            self._verdicts.append(judge_interval(expected, readings, self.tolerance, self.residual))
            over = len(self._verdicts) == len(self._course.intervals)
            yield CycleSoFar(self._course, start, tuple(self._verdicts), over)
            if over:
                self._end(end)

    def _decided(self, trace: Trace, now: float) -> bool:
        """True if the course is known: the one that fits best over the shortest first interval of the candidates."""
        if self._course is not None:
            return True
        assert self._start is not None
        until = min(course.intervals[0].end for course in self._possible)
        if now < until + AFTER:
            return False
        readings = _readings(trace, self._start)
        if not _known(readings, -BEFORE, until):
            self._end(self._start)
            return False
        misfits = [course.misfit(readings, until) for course in self._possible]
        best = int(np.argmin(misfits))
        if misfits[best] > FAR * readings.q.shape[1] / 2:
            self._end(self._start)
            return False
        self._course = self._possible[best]
        return True

    def _end(self, at: int) -> None:
        self._start = self._course = None
        self._possible, self._verdicts, self._free_from = (), [], at + 1


def _readings(trace: Trace, start: int) -> Readings:
    """Samples from one second before ``start`` (ns) on, without frames with missing values."""
    part = trace.between(start - 10**9, int(trace.time[-1]))
    known = np.isfinite(part.power) & np.isfinite(part.position).all(axis=1)
    return Readings(part.since(start)[known], part.position[known], part.power[known])


def _known(readings: Readings, start: float, end: float) -> bool:
    """True if samples have no hole longer than ``GAP`` between two times, s."""
    inside = readings.t[(readings.t > start) & (readings.t < end)]
    return bool(np.diff(np.concatenate([[start], inside, [end]])).max() <= GAP)
