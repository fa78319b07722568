"""Counters that wrap, are set back or misread now and then, as ones that only rise."""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

Change = Literal["wrapped", "reset", "misread"]

_NEAR: Final = 0.1
"""Share of a counter's range, from either end, within which a fall across the end is taken for a wrap."""
_FASTER: Final = 10.0
"""Times the fastest rise so far, beyond which a rise waits for the next readings."""
_SURE: Final = 3
"""Readings that a new level needs, or rises where the counter fell."""
_STANDS: Final = 60.0
"""s for which a counter that was set back to near 0 may stand still there until that is believed."""
_REGAINED: Final = 0.1
"""Share of a fall; a reading that regains more at once does not count on from the reading before."""
_ALIKE: Final = 0.001
"""Share of the value by which the first two readings may differ."""


class _Point(NamedTuple):
    time: float
    reading: float


class Counted(NamedTuple):
    """The value of a counter. ``held``: the last good value, as the reading is not believed yet."""

    value: float
    held: bool = False
    change: Change | None = None
    misread: int = 0
    """Number of readings before this one that turned out to be false."""


@dataclass(slots=True)
class _Level:
    """Readings elsewhere than the counter should be, which may be its new level or false."""

    base: float
    last: _Point
    since: float
    pace: float
    """Rise in 1/s up to which a reading counts on from the one before."""
    slack: float
    """Rise up to which it counts on, however soon."""
    readings: int = 1
    rises: int = 0
    fastest: float = 0.0


class RisingCounter:
    """Adds up what a counter counted; ``wraps_at`` is the value at which it begins anew, ``period`` s between polls.

    ``plausible`` is a rise in 1/s that the first readings may show without a third one that agrees.

    A reading that falls, or rises out of proportion, is not believed before the next ones count on from it: the value
    holds until then. What comes back to where it was has been misread and changes nothing. A fall that stays is a wrap
    (from near ``wraps_at`` to near 0: nothing is lost) or a reset: counting goes on from the last value, and what was
    counted between the two readings is lost. Values never fall; they are NaN until the first readings agree.
    """

    def __init__(self, wraps_at: float | None, period: float, plausible: float = 0.0) -> None:
        self._range = wraps_at
        self._period = period
        self._plausible = plausible
        self._seen: deque[_Point] = deque(maxlen=_SURE)
        self._settled = False
        self._added = 0.0
        self._top = -math.inf
        self._fastest = 0.0
        self._level: _Level | None = None
        self._doubted = 0
        """Readings since the last that was believed."""
        self._highest = -math.inf
        """Highest of these and of that one: a counter may wrap while its rise is not believed yet."""
        self._former: tuple[_Point, float] | None = None
        """Where the counter was before its last change of level, and what was added there."""

    def take(self, reading: float, time: float) -> Counted:
        """Return the value after a ``reading`` at ``time`` s; NaN passes through."""
        if math.isnan(reading):
            return Counted(math.nan)
        point = _Point(time, reading)
        if not self._settled:
            return self._begin(point)
        change, readings = self._place(point)
        value = self._seen[-1].reading + self._added
        held = self._level is not None or value < self._top
        self._top = max(self._top, value)
        return Counted(self._top, held, change, readings)

    def _begin(self, point: _Point) -> Counted:
        """Wait for two readings that rise plausibly or are nearly equal, or three that rise evenly."""
        self._seen.append(point)
        paces = [self._pace(a, b) for a, b in itertools.pairwise(self._seen)]
        plausible = bool(paces) and 0 <= paces[-1] <= self._plausible
        alike = bool(paces) and 0 <= point.reading - self._seen[-2].reading <= _ALIKE * point.reading
        even = len(paces) == _SURE - 1 and 0 < max(paces) <= _FASTER * min(paces)
        if not plausible and not alike and not even:
            return Counted(math.nan)
        self._settled, self._top, self._highest = True, point.reading, point.reading
        self._learn(paces[-1] if plausible or even else 0.0)
        self._seen = deque([point], _SURE)
        return Counted(point.reading)

    def _place(self, point: _Point) -> tuple[Change | None, int]:
        """Believe a reading, or hold it as a level; return what changed, and how many readings were false."""
        false = self._doubted
        if self._follows(self._seen[-1], point):
            if len(self._seen) > 1:
                self._learn(self._pace(self._seen[-2], self._seen[-1]))
            self._believe(point)
            return ("misread" if false else None), false
        for n, earlier in enumerate(reversed(self._seen)):
            if self._follows(earlier, point):  # those after it were too high
                self._seen = deque([earlier], _SURE)
                self._believe(point)
                return "misread", false + n
        self._extend(point)
        return self._adopt()

    def _follows(self, before: _Point, point: _Point) -> bool:
        return 0 <= point.reading - before.reading <= _FASTER * self._fastest * self._seconds(before, point)

    def _seconds(self, before: _Point, point: _Point) -> float:
        return max(point.time - before.time, self._period)

    def _pace(self, before: _Point, point: _Point) -> float:
        return (point.reading - before.reading) / self._seconds(before, point)

    def _learn(self, pace: float) -> None:
        self._fastest = max(self._fastest, pace)

    def _believe(self, point: _Point) -> None:
        self._seen.append(point)
        self._level, self._doubted, self._highest = None, 0, point.reading
        if self._former and point.reading > self._former[0].reading:
            self._former = None

    def _extend(self, point: _Point) -> None:
        """Add a reading to the level that is held, or begin one with it."""
        level, last = self._level, self._seen[-1]
        self._doubted += 1
        self._highest = max(self._highest, point.reading)
        if level and level.base <= point.reading < level.last.reading:
            level.readings, level.rises, level.last = level.readings + 1, 0, point
            return
        if level and point.reading >= level.last.reading:
            rise, pace = point.reading - level.last.reading, self._pace(level.last, point)
            if pace <= level.pace or rise <= level.slack:
                level.readings, level.rises, level.last = level.readings + 1, level.rises + (rise > 0), point
                level.fastest = max(level.fastest, pace)
                return
        pace, slack = self._fastest, _REGAINED * (last.reading - point.reading)
        if point.reading > last.reading:
            pace, slack = max(pace, self._pace(last, point)), 0.0
        self._level = _Level(point.reading, point, point.time, _FASTER * pace, slack)

    def _adopt(self) -> tuple[Change | None, int]:
        """Go on from the level that is held, once that is sure; return as ``_place`` does."""
        level, last, added, former = self._level, self._seen[-1], self._added, self._former
        assert level is not None
        change: Change | None = None
        if level.base > last.reading:
            if level.readings < _SURE:
                return None, 0
            self._former = None
            if former and level.base >= former[0].reading:  # the fall before is taken back
                change, self._added = "misread", former[1]
            elif not self._fastest and last.reading > 0:
                self._learn(self._pace(last, level.last))
        else:
            change = self._fall(level, last)
            if change is None:
                return None, 0
            self._former = (last, added)
            self._added += self._range if change == "wrapped" and self._range else last.reading - level.base
        self._learn(level.fastest)
        self._seen.clear()
        false = self._doubted - level.readings
        self._believe(level.last)
        return change, false

    def _fall(self, level: _Level, last: _Point) -> Change | None:
        """Return what a fall to this level is, once that is sure."""
        full, counts_on = self._range, level.rises >= _SURE
        if full is not None and (1 - _NEAR) * full < self._highest <= full and level.base < _NEAR * full:
            return "wrapped" if counts_on or (level.readings >= _SURE and level.base > 0) else None
        stands = level.base < _NEAR * last.reading and level.last.time - level.since >= _STANDS
        return "reset" if counts_on or stands else None
