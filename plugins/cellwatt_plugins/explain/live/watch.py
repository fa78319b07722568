"""Channels outside their bands, and since when: the alarms ``simulation_differs``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cellwatt.alarms import AlarmBook
from cellwatt.results import Alarm, Interval
from cellwatt_plugins.explain.live.band import IntervalResidual

KIND = "simulation_differs"
STALE = 100
"""Intervals of a channel after which a motion that was outside, and no longer occurs, stops counting."""


@dataclass
class _Motion:
    """A motion in which a channel was outside its band: since when (ns), how often, and how often inside in a row since
    then."""

    since: int
    outside: int = 0
    inside: int = 0
    seen: int = 0


@dataclass
class ChannelWatch:
    """The channels of one stage; ``prefix`` starts the alarms' ids.

    A simulation may fit one motion and miss another, so each motion is counted separately. ``confirm`` intervals
    outside the band, with no later interval of the same motion inside, raise the channel's alarm. The alarm is cleared
    when each of those motions was inside ``confirm`` times in a row.
    """

    prefix: str
    source: str
    confirm: int
    _outside: dict[str, dict[int, _Motion]] = field(default_factory=dict)
    """By alarm id: the motions in which the channel is outside."""
    _readings: Counter[str] = field(default_factory=Counter)
    _book: AlarmBook = field(default_factory=AlarmBook)

    def take(self, motion: int, interval: Interval, readings: Sequence[IntervalResidual]) -> list[Alarm]:
        """Alarms that change with the residuals of one more interval of this motion."""
        return [alarm for reading in readings for alarm in self._take(motion, interval, reading)]

    @property
    def outside(self) -> int:
        """Largest number of intervals outside, of the channels with an active alarm; 0 if there is none."""
        return max((sum(motion.outside for motion in motions.values()) for motions in self._up), default=0)

    @property
    def since(self) -> int:
        """ns of the first evidence of all active alarms."""
        return min(motion.since for motions in self._up for motion in motions.values())

    @property
    def _up(self) -> list[dict[int, _Motion]]:
        return [motions for name, motions in self._outside.items() if name in self._book]

    def _take(self, motion: int, interval: Interval, reading: IntervalResidual) -> list[Alarm]:
        c = reading.channel
        name = f"{self.prefix}.{c.name}.{KIND}"
        motions = self._count(name, motion, interval, reading.outside)
        times = sum(each.outside for each in motions.values())
        if name not in self._book and times >= self.confirm:
            since = min(each.since for each in motions.values())
            return self._book.raise_(self._alarm(name, interval, reading, since, times))
        if motions:
            return []
        text = f"Resolved: {c.what[0].lower()}{c.what[1:]} is back in its band: {reading.residual:.3g} of "
        text += f"{reading.limit:.3g} {c.unit}"
        evidence = {"channel": c.name, **_figures(reading)}
        return self._book.clear(name, interval.end, text, interval=interval.number, evidence=evidence)

    def _count(self, name: str, motion: int, interval: Interval, outside: bool) -> dict[int, _Motion]:
        """Count an interval; return the motions in which the channel is then outside."""
        self._readings[name] += 1
        now, motions = self._readings[name], self._outside.get(name, {})
        if outside or motion in motions:
            found = motions.setdefault(motion, _Motion(interval.start))
            found.outside, found.inside = (found.outside + 1, 0) if outside else (found.outside, found.inside + 1)
            found.seen = now
        patience = self.confirm if name in self._book else 1
        self._outside[name] = {n: m for n, m in motions.items() if m.inside < patience and now - m.seen < STALE}
        return self._outside[name]

    def _alarm(self, name: str, interval: Interval, reading: IntervalResidual, since: int, times: int) -> Alarm:
        c = reading.channel
        how = "on average" if c.joint is None else "(root mean square)"
        text = (
            f"{c.what} differs from the simulation by {reading.residual:.3g} {c.unit} {how}, and was outside its "
            f"band of {reading.limit:.3g} {c.unit} in {times} intervals."
        )
        evidence = {"channel": c.name, "intervals": times, **_figures(reading)}
        end, number = interval.end, interval.number
        return Alarm(
            name, KIND, "warning", True, since, end, text, self.source, c.joint, interval=number, evidence=evidence
        )


def _figures(reading: IntervalResidual) -> dict[str, Any]:
    unit = reading.channel.unit
    return {
        f"residual_{unit}": reading.residual,
        f"mean_{unit}": reading.mean,
        f"limit_{unit}": reading.limit,
        f"simulated_{unit}": reading.simulated,
        f"noise_floor_{unit}": reading.noise,
    }
