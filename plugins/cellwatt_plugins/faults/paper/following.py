"""Finds the cycles of a running arm and judges their intervals as soon as each is over."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwatt.results import Interval
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.paper.codes import Residual
from cellwatt_plugins.faults.paper.course import FAR, Course
from cellwatt_plugins.faults.paper.expected import Readings
from cellwatt_plugins.faults.paper.judging import IntervalVerdict, judge_interval
from cellwatt_plugins.faults.trace import Trace

AFTER = 0.12
"""An interval is judged when it has been over for so long, s."""
BEFORE = 0.2
"""A cycle whose last so many s of rest were not seen may have begun earlier: it is not judged."""
GAP = 0.1
"""Nor is one in which frames are missing for longer than this, s."""
MARGIN = 2 * 10**9
"""Frames kept before the cycle under way, ns."""


@dataclass(frozen=True)
class CycleSoFar:
    """A cycle since ``start`` (ns) and what its intervals said until now; ``over`` when it was the last."""

    course: Course
    start: int
    verdicts: tuple[IntervalVerdict, ...]
    over: bool


@dataclass
class CyclesSeen:
    """Follows the cycles of one arm out of its frames and its intervals, block by block.

    ``latest`` is the number of the motion under way.
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
        """The cycle under way after each of its intervals that is known to be over; ``intervals`` are of this block."""
        self._trace = Trace.joined([self._trace, block])
        for interval in intervals:
            # An interval comes open, ending at the frame that confirmed it, and closed later.
            if interval.moving and not interval.closed:
                yield from self._judge(self._trace.between(0, interval.end))
                self.latest = interval.number
                self._see(interval)
        yield from self._judge(self._trace)
        if len(self._trace):
            newest = int(self._trace.time[-1])
            self._trace = self._trace.between((self._start or newest) - MARGIN, newest)

    def _see(self, interval: Interval) -> None:
        """A motion has begun: it may be the first of a cycle."""
        if self._start is not None or interval.start < self._free_from or not interval.complete:
            return
        self._possible = [course for course in self.courses if course.begins_with(interval)]
        if self._possible:
            self._start = interval.start

    def _judge(self, trace: Trace) -> Iterator[CycleSoFar]:
        """The cycle under way after each interval that has ended within ``trace``."""
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
        """True if the speed is known: that which fits best, for as long as the fastest takes for its first interval."""
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
    """Readings from a second before ``start`` (ns) on; frames with something missing are left out."""
    part = trace.between(start - 10**9, int(trace.time[-1]))
    known = np.isfinite(part.power) & np.isfinite(part.position).all(axis=1)
    return Readings(part.since(start)[known], part.position[known], part.power[known])


def _known(readings: Readings, start: float, end: float) -> bool:
    """True if no stretch longer than ``GAP`` is missing between two times, s."""
    inside = readings.t[(readings.t > start) & (readings.t < end)]
    return bool(np.diff(np.concatenate([[start], inside, [end]])).max() <= GAP)
