"""Makes counters that wrap, are reset or are misread into counters that only rise."""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

Change = Literal["wrapped", "reset", "misread", "held"]

_NEAR: Final = 0.1
"""Share of a counter's range, from either end, within which a fall across the end counts as a wrap."""
_FASTER: Final = 10.0
"""Multiple of the fastest rise so far, above which a rise must be confirmed by the next values."""
_SURE: Final = 3
"""Number of values that confirm a new level, or of rises after a fall."""
_STANDS: Final = 60.0
"""s for which a counter at rest near 0 confirms that it was reset; so long without a confirmed value is told."""
_REGAINED: Final = 0.1
"""Share of a fall; a value that regains more at once does not continue from the value before."""
_ALIKE: Final = 0.001
"""Share of the value by which the first two values may differ."""


class _Point(NamedTuple):
    time: float
    reading: float


class Counted(NamedTuple):
    """The value of a counter. ``held``: the last good value, because the new one is not confirmed yet.

    The change ``held`` says once that no value has been confirmed for ``_STANDS`` s.
    """

    value: float
    held: bool = False
    change: Change | None = None
    misread: int = 0
    """Number of earlier values that proved to be misread."""


@dataclass(slots=True)
class _Level:
    """Values off the counter's course, which are either its new level or misread."""

    base: float
    last: _Point
    since: float
    pace: float
    """Rise in 1/s up to which a value continues from the one before."""
    slack: float
    """Rise up to which a value continues, at any rate."""
    readings: int = 1
    rises: int = 0
    fastest: float = 0.0


class RisingCounter:
    """Adds up a counter's rises; ``wraps_at`` is the value at which it restarts from 0, ``period`` s between polls.

    ``plausible`` is the rise in 1/s up to which two first values suffice, without a third one that agrees.

    A value that falls, or rises out of proportion, is confirmed only when the next ones continue from it: until then
    the last value holds. A value that returns to the old course proves the others misread; they change nothing. A fall
    that stays is a wrap (from near ``wraps_at`` to near 0: nothing is lost) or a reset: counting continues from the
    last value, and counts between the two values are lost. Values never fall; they are NaN until the first values
    agree.
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
        """Number of values since the last confirmed one."""
        self._highest = -math.inf
        """Highest of these values and the confirmed one: a counter may wrap while its rise is not confirmed yet."""
        self._former: tuple[_Point, float] | None = None
        """Last value before the latest change of level, and the amount added then."""
        self._waits: float | None = None
        """Time of the first value since the last confirmed one; infinite once that was told."""

    def take(self, reading: float, time: float) -> Counted:
        """Return the value after a ``reading`` at ``time`` s; NaN is returned unchanged."""
        if math.isnan(reading):
            return Counted(math.nan)
        point = _Point(time, reading)
        counted = self._continue(point) if self._settled else self._begin(point)
        if self._settled and self._level is None:
            self._waits = None
            return counted
        self._waits = time if self._waits is None else self._waits
        if time - self._waits < _STANDS:
            return counted
        self._waits = math.inf
        return counted._replace(change="held")

    def _continue(self, point: _Point) -> Counted:
        change, readings = self._place(point)
        value = self._seen[-1].reading + self._added
        held = self._level is not None or value < self._top
        self._top = max(self._top, value)
        return Counted(self._top, held, change, readings)

    def _begin(self, point: _Point) -> Counted:
        """Wait for two values that rise plausibly or are nearly equal, or three that rise evenly."""
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
        """Confirm a value, or hold it as a level; return the change, and how many values were misread."""
        false = self._doubted
        if self._follows(self._seen[-1], point):
            if len(self._seen) > 1:
                self._learn(self._pace(self._seen[-2], self._seen[-1]))
            self._believe(point)
            return ("misread" if false else None), false
        for n, earlier in enumerate(reversed(self._seen)):
            if self._follows(earlier, point):  # the values after it were too high
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
        """Add a value to the unconfirmed level, or begin a level with it."""
        level, last = self._level, self._seen[-1]
        self._doubted += 1
        self._highest = max(self._highest, point.reading)
        if level and point.reading >= level.base:
            rise, pace = point.reading - level.last.reading, self._pace(level.last, point)
            if rise < 0 or pace <= level.pace or rise <= level.slack:
                level.readings, level.last, level.fastest = level.readings + 1, point, max(level.fastest, pace)
                level.rises = level.rises + (rise > 0) if rise >= 0 else 0
                return
        pace, slack = self._fastest, _REGAINED * (last.reading - point.reading)
        if point.reading > last.reading:
            pace, slack = max(pace, self._pace(last, point)), 0.0
        self._level = _Level(point.reading, point, point.time, _FASTER * pace, slack)

    def _adopt(self) -> tuple[Change | None, int]:
        """Continue from the unconfirmed level if it is confirmed; returns the same as ``_place``."""
        level, last, added, former = self._level, self._seen[-1], self._added, self._former
        assert level is not None
        change: Change | None = None
        if level.base > last.reading:
            if level.readings < _SURE:
                return None, 0
            self._former = None
            if former and level.base >= former[0].reading:  # the earlier fall was a misread
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
        """Return the kind of a fall to this level; None while it is not confirmed."""
        full, counts_on = self._range, level.rises >= _SURE
        if full is not None and (1 - _NEAR) * full < self._highest <= full and level.base < _NEAR * full:
            return "wrapped" if counts_on or (level.readings >= _SURE and level.base > 0) else None
        stands = level.base < _NEAR * last.reading and level.last.time - level.since >= _STANDS
        return "reset" if counts_on or stands else None
