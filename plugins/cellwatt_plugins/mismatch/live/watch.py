"""Channels outside their bands and since when: the alarms ``simulation_differs``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cellwatt.alarms import AlarmBook
from cellwatt.results import Alarm, Interval
from cellwatt_plugins.mismatch.live.band import Reading

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
    """One channel: readings so far and the motions that it is outside in."""

    readings: int = 0
    motions: dict[int, _Motion] = field(default_factory=dict)

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
    _courses: dict[str, _Course] = field(default_factory=dict)
    """By the ids of their alarms."""
    _book: AlarmBook = field(default_factory=AlarmBook)

    def take(self, motion: int, interval: Interval, readings: Sequence[Reading]) -> list[Alarm]:
        """Alarms that change with what was read of one more interval, which is of this motion."""
        return [alarm for reading in readings for alarm in self._take(motion, interval, reading)]

    @property
    def outside(self) -> int:
        """Readings outside of the channel that has most, of those whose alarm is up; 0 where none is."""
        return max((course.outside for course in self._up), default=0)

    @property
    def since(self) -> int:
        """ns of the first evidence of all alarms that are up."""
        return min(course.since for course in self._up)

    @property
    def _up(self) -> list[_Course]:
        return [course for name, course in self._courses.items() if name in self._book]

    def _take(self, motion: int, interval: Interval, reading: Reading) -> list[Alarm]:
        c = reading.channel
        name = f"{self.prefix}.{c.name}.{KIND}"
        course = self._courses.setdefault(name, _Course())
        self._count(course, motion, interval, reading.outside, patience=self.confirm if name in self._book else 1)
        if name not in self._book and course.outside >= self.confirm:
            return self._book.raise_(self._alarm(name, interval, reading, course))
        if course.motions:
            return []
        text = f"Resolved: {c.what[0].lower()}{c.what[1:]} is back in its band: {reading.residual:.3g} of "
        text += f"{reading.limit:.3g} {c.unit}"
        evidence = {"channel": c.name, **_figures(reading)}
        return self._book.clear(name, interval.end, text, interval=interval.number, evidence=evidence)

    def _count(self, course: _Course, motion: int, interval: Interval, outside: bool, *, patience: int) -> None:
        """Count a reading; ``patience`` readings inside in a row end what a motion was outside."""
        course.readings += 1
        if outside:
            found = course.motions.setdefault(motion, _Motion(interval.start))
            found.outside, found.inside, found.seen = found.outside + 1, 0, course.readings
        elif motion in course.motions:
            found = course.motions[motion]
            found.inside, found.seen = found.inside + 1, course.readings
            if found.inside >= patience:
                del course.motions[motion]
        course.motions = {n: m for n, m in course.motions.items() if course.readings - m.seen < STALE}

    def _alarm(self, name: str, interval: Interval, reading: Reading, course: _Course) -> Alarm:
        c = reading.channel
        how = "on average" if c.joint is None else "(root mean square)"
        return Alarm(
            id=name,
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


def _figures(reading: Reading) -> dict[str, Any]:
    unit = reading.channel.unit
    return {
        f"residual_{unit}": reading.residual,
        f"mean_{unit}": reading.mean,
        f"limit_{unit}": reading.limit,
        f"simulated_{unit}": reading.simulated,
        f"noise_floor_{unit}": reading.noise,
    }
