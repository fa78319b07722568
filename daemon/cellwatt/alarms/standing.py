"""The state of one alarm, and the alarms of a cell or stage with their state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from cellwatt.results import Alarm, Event, Severity

WORDS: Final = ("acknowledged", "shelved", "unshelved")
"""Kinds of the events that report the action of a person on an alarm."""
SEVERITIES: Final[tuple[Severity, ...]] = ("info", "warning", "error")
"""In ascending order."""


@dataclass(frozen=True, slots=True)
class Patience:
    """Consecutive observations, and s from the first to the last, before an alarm is raised or cleared."""

    times: int = 1
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """A person's acknowledgement of an alarm, at ``time`` UTC ns; it holds until the alarm is cleared."""

    name: str
    note: str
    time: int


@dataclass(frozen=True, slots=True)
class Shelf:
    """A person's order not to publish an alarm before ``until`` ns, unless its severity rises above ``severity``."""

    name: str
    note: str
    time: int
    until: int
    severity: Severity


@dataclass(slots=True)
class Standing:
    """State of one alarm; ``alarm`` has the newest figures of its condition, ``over`` is the clear that followed."""

    alarm: Alarm
    over: Alarm | None = None
    holds: bool = False
    """True once the condition has held through the patience, until it has been absent through the patience."""
    changed: int = 0
    """Time of the last change of ``holds``, ns."""
    streak: int = 0
    """Consecutive observations that contradict ``holds``."""
    streak_since: int = 0
    """Time of the first of these, ns."""
    raises: tuple[int, ...] = ()
    """Times at which ``holds`` became true, ns, within the last span of damping."""
    flaps: int = 0
    """Clears held back by damping; 0 if the alarm does not come and go."""
    published: Alarm | None = None
    """The last message published, unless that was a clear."""
    acknowledgement: Acknowledgement | None = None
    shelf: Shelf | None = None
    evidence: str | None = None
    """File of its evidence pack, once that is written."""
    news: bool = False
    """The last message received changed more than figures: a raise, a clear, or another severity or joint."""

    @property
    def raised(self) -> bool:
        """True while the condition holds or damping keeps the alarm active."""
        return self.holds or self.flaps > 0

    @property
    def message(self) -> Alarm:
        """The message to publish for the present state."""
        if not self.raised and self.over is not None:
            return self.over
        if not self.flaps:
            return self.alarm
        text = f"{self.alarm.statement} The condition comes and goes; the alarm stays active until it is steady."
        return replace(self.alarm, statement=text, evidence={**self.alarm.evidence, "flaps": self.flaps})

    def acknowledged_after(self, time: int) -> bool:
        """True if a person acknowledged it after ``time``, UTC ns."""
        return self.acknowledgement is not None and self.acknowledgement.time > time

    def observe(self, holds: bool, time: int, after: Patience) -> bool:
        """Count an observation at ``time``; return True if enough observations contradict ``holds`` to change it."""
        if holds == self.holds:
            self.streak = 0
            return False
        self.streak_since = self.streak_since if self.streak else time
        self.streak += 1
        return self.streak >= after.times and time - self.streak_since >= after.seconds * 1e9


class Standings:
    """Alarms with their state, by id, and how people's actions and evidence packs change it."""

    def __init__(self) -> None:
        self._standing: dict[str, Standing] = {}

    def __iter__(self) -> Iterator[str]:
        """Ids of all known alarms, active or not."""
        return iter(tuple(self._standing))

    def __contains__(self, alarm_id: str) -> bool:
        return alarm_id in self._standing and self._standing[alarm_id].raised

    def __getitem__(self, alarm_id: str) -> Standing:
        return self._standing[alarm_id]

    @property
    def raised(self) -> list[Standing]:
        """Active alarms, in the order in which they were raised."""
        return [standing for standing in self._standing.values() if standing.raised]

    @property
    def up(self) -> list[Standing]:
        """Alarms that consumers know to be active: raised, published, and not on the shelf."""
        return [s for s in self._standing.values() if s.raised and s.published is not None and s.shelf is None]

    @property
    def shelved(self) -> list[Standing]:
        """Alarms that are raised and on the shelf."""
        return [s for s in self._standing.values() if s.raised and s.shelf is not None]

    def note(self, event: Event) -> list[Standing]:
        """Apply an event about alarms, also repeatedly; return the active alarms that it concerns.

        The event reports a person's action or the file of an evidence pack. Other events are ignored.
        """
        data, kind = event.data, event.kind
        several = kind == "evidence" and "pack" in data
        ids: Iterable[str] = data.get("alarms", ()) if several else [data["alarm"]] if kind in WORDS else ()
        found = [self._standing[alarm_id] for alarm_id in ids if alarm_id in self]
        for standing in found:
            match kind:
                case "acknowledged":
                    standing.acknowledgement = Acknowledgement(data["name"], data["note"], event.time)
                case "shelved":
                    about = data["name"], data["note"], event.time, data["until"]
                    standing.shelf = Shelf(*about, standing.alarm.severity)
                case "unshelved":
                    standing.shelf = None
                case _:
                    standing.evidence = str(data["pack"])
        return found
