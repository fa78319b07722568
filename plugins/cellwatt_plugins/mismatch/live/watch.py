"""Which channels are outside their bands and since when: alarms that are raised once and cleared once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwatt.results import Alarm, Interval
from cellwatt_plugins.mismatch.live.band import Reading
from cellwatt_plugins.mismatch.live.intake import Judged

KIND = "simulation_differs"
STALE = 100
"""Readings of a channel after which a motion that was outside, and is not done any more, no longer counts."""


@dataclass
class _Motion:
    """A motion that a channel was last outside in: since when (ns), how often, and inside in a row since then."""

    since: int
    outside: int = 0
    inside: int = 0
    seen: int = 0


@dataclass
class _Course:
    """One channel: readings so far, the motions that it is outside in, and its alarm while it is up."""

    readings: int = 0
    motions: dict[int, _Motion] = field(default_factory=dict)
    alarm: Alarm | None = None

    @property
    def outside(self) -> int:
        """Readings outside of the motions that it is outside in."""
        return sum(motion.outside for motion in self.motions.values())

    @property
    def since(self) -> int:
        """ns of the first of them."""
        return min(motion.since for motion in self.motions.values())


@dataclass
class ChannelWatch:
    """The channels of one stage; ``prefix`` starts the alarms' ids.

    A simulation may fit one motion and miss another, so each counts for itself: ``confirm`` readings outside, that no
    reading inside of the same motion came after, raise a channel's alarm; it is cleared when each of those motions was
    inside as many times in a row.
    """

    prefix: str
    source: str
    confirm: int
    _courses: dict[Judged, _Course] = field(default_factory=dict)

    def take(self, motion: int, interval: Interval, readings: Sequence[Reading]) -> list[Alarm]:
        """Alarms that change with what was read of one more interval, which is of this motion."""
        return [alarm for r in readings if (alarm := self._take(motion, interval, r)) is not None]

    @property
    def outside(self) -> int:
        """Readings outside of the channel that has most, of those whose alarm is up; 0 where none is."""
        return max((course.outside for course in self._courses.values() if course.alarm is not None), default=0)

    @property
    def since(self) -> int:
        """ns of the first evidence of all alarms that are up."""
        return min(course.since for course in self._courses.values() if course.alarm is not None)

    def _take(self, motion: int, interval: Interval, reading: Reading) -> Alarm | None:
        course = self._courses.setdefault(reading.channel, _Course())
        self._count(course, motion, interval, reading.outside)
        if course.alarm is None and course.outside >= self.confirm:
            course.alarm = self._raised(interval, reading, course)
            return course.alarm
        if course.alarm is not None and not course.motions:
            alarm, course.alarm = course.alarm, None
            return _cleared(alarm, interval, reading)
        return None

    def _count(self, course: _Course, motion: int, interval: Interval, outside: bool) -> None:
        course.readings += 1
        if outside:
            found = course.motions.setdefault(motion, _Motion(interval.start))
            found.outside, found.inside, found.seen = found.outside + 1, 0, course.readings
        elif motion in course.motions:
            found = course.motions[motion]
            found.inside, found.seen = found.inside + 1, course.readings
            if course.alarm is None or found.inside >= self.confirm:
                del course.motions[motion]
        course.motions = {n: m for n, m in course.motions.items() if course.readings - m.seen < STALE}

    def _raised(self, interval: Interval, reading: Reading, course: _Course) -> Alarm:
        c = reading.channel
        how = "on average" if c.joint is None else "(root mean square)"
        return Alarm(
            id=f"{self.prefix}.{c.name}.{KIND}",
            kind=KIND,
            severity="warning",
            active=True,
            since=course.since,
            time=interval.end,
            statement=f"{c.what} is off the simulation by {reading.residual:.3g} {c.unit} {how}, and was outside its "
            f"band in {course.outside} intervals; the band is {reading.limit:.3g} {c.unit}.",
            source=self.source,
            joint=c.joint,
            interval=interval.number,
            evidence={"channel": c.name, "intervals": course.outside, **_figures(reading)},
        )


def _cleared(alarm: Alarm, interval: Interval, reading: Reading) -> Alarm:
    c = reading.channel
    statement = f"{c.what} is back in its band: {reading.residual:.3g} of {reading.limit:.3g} {c.unit}."
    evidence = {"channel": c.name, **_figures(reading)}
    return replace(
        alarm, active=False, time=interval.end, statement=statement, interval=interval.number, evidence=evidence
    )


def _figures(reading: Reading) -> dict[str, Any]:
    unit = reading.channel.unit
    return {
        f"residual_{unit}": reading.residual,
        f"mean_{unit}": reading.mean,
        f"limit_{unit}": reading.limit,
        f"simulated_{unit}": reading.simulated,
        f"noise_floor_{unit}": reading.noise,
    }
