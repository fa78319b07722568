"""The alarm book: raises, updates and clears alarms by id, with patience, damping, acknowledgement and shelf.

Pure: times are arguments, UTC ns, and the same calls give the same alarms. A book decides (``raise_``, ``clear``,
``look``), or follows another one by its messages (``hear``), events (``note``) and health (``agree``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import pydantic_core
from pydantic import TypeAdapter

from cellwatt.errors import CellwattError
from cellwatt.results import Alarm, Event, Severity

LOST: Final = "Cleared; the message with the reason was not received."
"""Statement of the clear of an alarm that the cell no longer lists, although its own clear was not received."""
RESTARTED: Final = "The daemon ended while this alarm was active; after its restart it raises alarms that still hold."
"""Statement of the clear of an alarm that was active when the daemon ended."""
WORDS: Final = ("acknowledged", "shelved", "unshelved")
"""Kinds of the events that report the action of a person on an alarm."""
SEVERITIES: Final[tuple[Severity, ...]] = ("info", "warning", "error")
"""In ascending order."""


@dataclass(frozen=True, slots=True)
class Patience:
    """Consecutive observations, and s from the first to the last, before an alarm is raised or cleared."""

    times: int = 1
    seconds: float = 0.0


AT_ONCE: Final = Patience()


@dataclass(frozen=True, slots=True)
class Damping:
    """An alarm raised more than ``times`` times in ``seconds`` stays raised until it is steady for ``seconds``."""

    times: int = 5
    seconds: float = 600.0


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


_STATE: Final = TypeAdapter(list[Standing])
_ALARM: Final = TypeAdapter(Alarm)
_CLEARS: Final = 500
"""Number of clears whose time is stored, so that an older health message does not raise their alarms again."""


class AlarmBook:
    """Alarms of one stage or of a whole cell; without ``damping`` each follows its condition.

    Methods that change an alarm return the messages to publish. ``state`` is the ``state()`` of another book.
    """

    def __init__(self, damping: Damping | None = None, state: Iterable[Any] = ()) -> None:
        self._damping = damping
        self._standing = _standings(state)
        self._expected: dict[str, Standing] = {}
        self._expected_until = 0
        self._over: dict[str, int] = {}
        """Times of the clears received, ns, by alarm id."""

    def state(self) -> list[Any]:
        """The whole state of the book, JSON-ready."""
        return _plain(self._standing.values())

    def words(self) -> list[Any]:
        """State of the acknowledged and shelved alarms."""
        return _plain(s for s in self._standing.values() if s.acknowledgement or s.shelf)

    def adopt(self, state: Iterable[Any]) -> None:
        """Add the alarms of ``state``; they replace alarms with the same ids."""
        self._standing |= _standings(state)

    def expect(self, words: Iterable[Any], until: int) -> None:
        """Restore the acknowledgements ``words`` of alarms that are raised before ``until`` ns.

        A shelf is restored if its alarm is raised before the shelf ends.
        """
        self._expected, self._expected_until = _standings(words), until

    # active alarms --------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[str]:
        """Ids of all alarms that the book knows, active or not."""
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

    # conditions -----------------------------------------------------------------------------------

    def raise_(self, alarm: Alarm, *, after: Patience = AT_ONCE, update: bool = True) -> list[Alarm]:
        """Note at ``alarm.time`` that the condition of an alarm holds: raise it after patience, or update it.

        An active alarm keeps its ``since``; with ``update`` false it keeps all its figures, and nothing is published.
        """
        standing = self._standing.setdefault(alarm.id, Standing(alarm))
        self._settle(standing, alarm.time)
        begins = standing.observe(True, alarm.time, after)
        if not (begins or (standing.holds and update)):
            return []
        standing.alarm = replace(alarm, since=standing.alarm.since) if standing.raised else alarm
        if begins:
            self._change(standing, alarm.time)
            self._recall(standing, alarm.time)
        return _published(standing, alarm.time)

    def clear(
        self, alarm_id: str, time: int, statement: str, *, after: Patience = AT_ONCE, **changes: Any
    ) -> list[Alarm]:
        """Note that the condition of an alarm is absent, and clear the alarm after patience, if it is active.

        ``{times}`` in the statement stands for the number of consecutive observations without the condition;
        ``changes`` are other fields of the message.
        """
        if alarm_id not in self._standing:
            return []
        alarm = self._standing[alarm_id].alarm
        return self._end(replace(alarm, active=False, time=time, statement=statement, **changes), after)

    def take(self, alarm: Alarm) -> list[Alarm]:
        """Raise, update or clear at once by another book's message; the clear of an unknown alarm is returned as is."""
        if alarm.active:
            return self.raise_(alarm)
        return self._end(alarm, AT_ONCE) if alarm.id in self._standing else [alarm]

    def _end(self, over: Alarm, after: Patience) -> list[Alarm]:
        standing, found = self._standing[over.id], []
        self._settle(standing, over.time)
        if standing.observe(False, over.time, after):
            standing.over = replace(over, statement=over.statement.replace("{times}", str(standing.streak)))
            self._change(standing, over.time)
            found = _published(standing, over.time)
        self._forget(standing, over.time)
        return found

    def look(self, now: int) -> list[Alarm]:
        """End what ends by time: shelves, and the damping of steady alarms."""
        found = []
        for standing in list(self._standing.values()):
            self._settle(standing, now)
            if standing.shelf is not None and now >= standing.shelf.until:
                standing.shelf = None
            before = standing.published
            if before is None or replace(standing.message, time=before.time) != before:
                found += _published(standing, now)
            self._forget(standing, now)
        return found

    # people ---------------------------------------------------------------------------------------

    def acknowledge(self, alarm_id: str, name: str, note: str, time: int) -> None:
        """Note that a person acknowledged an alarm. Raises ``CellwattError`` if it is not active."""
        self._known(alarm_id).acknowledgement = Acknowledgement(name, note, time)

    def shelve(self, alarm_id: str, until: int, name: str, note: str, time: int) -> None:
        """Do not publish an alarm before ``until`` ns, unless its severity rises.

        Raises ``CellwattError`` if it is not active.
        """
        standing = self._known(alarm_id)
        standing.shelf = Shelf(name, note, time, until, standing.alarm.severity)

    def unshelve(self, alarm_id: str, time: int) -> list[Alarm]:
        """Take an alarm off the shelf; return the messages that the shelf held back.

        Raises ``CellwattError`` if it is not on the shelf.
        """
        standing = self._standing.get(alarm_id)
        if standing is None or standing.shelf is None:
            raise CellwattError(f"the alarm {alarm_id!r} is not shelved: its time may be over")
        standing.shelf = None
        return self.look(time)

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

    def _recall(self, standing: Standing, time: int) -> None:
        """Restore the acknowledgement and shelf that an alarm had before a restart."""
        before = self._expected.pop(standing.alarm.id, None)
        if before is None:
            return
        if time < self._expected_until:
            standing.acknowledgement = before.acknowledgement
        if before.shelf is not None and time < before.shelf.until:
            standing.shelf = before.shelf

    def _known(self, alarm_id: str) -> Standing:
        if alarm_id not in self:
            raise CellwattError(f"no alarm {alarm_id!r} is active: it may have been cleared")
        return self._standing[alarm_id]

    # between books --------------------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Active alarms with their acknowledgements, and shelved alarms, JSON-ready, for health."""
        alarms = [
            {**{k: getattr(s.published, k) for k in Alarm.__slots__}, "acknowledged": _fields(s.acknowledgement)}
            for s in self.up
        ]
        about = ("id", "kind", "severity", "statement", "since")
        shelved = [{**{k: getattr(s.alarm, k) for k in about}, "shelf": _fields(s.shelf)} for s in self.shelved]
        return {"alarms": alarms, "shelved": shelved}

    def hear(self, alarm: Alarm) -> Standing:
        """Apply a message that another book published; return the new state of the alarm."""
        standing = self._standing.pop(alarm.id, None) or Standing(alarm)
        before = standing.published
        if not alarm.active:
            standing.over, standing.published, standing.holds = alarm, None, False
            standing.acknowledgement, standing.news = None, True
            self._over[alarm.id] = alarm.time
            while len(self._over) > _CLEARS:
                del self._over[next(iter(self._over))]
            return standing
        standing.news = before is None or (before.severity, before.joint) != (alarm.severity, alarm.joint)
        standing.alarm = standing.published = alarm
        standing.holds, standing.shelf = True, None
        self._standing[alarm.id] = standing
        return standing

    def agree(self, health: Mapping[str, Any]) -> list[Standing]:
        """Apply the alarms in the health of another book's cell (see ``status``); return those that changed thereby."""
        time: int = health["time"]
        alarms = {body["id"]: body for body in health.get("alarms", ())}
        shelved = {body["id"]: body for body in health.get("shelved", ())}
        over = [s.alarm for s in self.raised if s.alarm.id not in {**alarms, **shelved} and s.alarm.time <= time]
        found = [self.hear(replace(alarm, active=False, time=time, statement=LOST)) for alarm in over]
        for alarm_id, body in alarms.items():
            if self._over.get(alarm_id, time) > time:
                continue  # it was cleared after that
            fields, known = {k: v for k, v in body.items() if k != "acknowledged"}, self._standing.get(alarm_id)
            word = None if body.get("acknowledged") is None else Acknowledgement(**body["acknowledged"])
            if known is None or known.shelf is not None:
                found.append(known := self.hear(_ALARM.validate_python(fields)))
            elif word != known.acknowledgement and not (word is None and known.acknowledged_after(time)):
                found.append(known)
                known.news = False
            else:
                continue
            known.acknowledgement = word
        for alarm_id, body in shelved.items():
            alarm = _ALARM.validate_python(
                {k: v for k, v in body.items() if k != "shelf"} | {"active": True, "time": time}
            )
            known = self._standing.setdefault(alarm_id, Standing(alarm, holds=True))
            known.shelf = Shelf(**body["shelf"])
        return found

    def restarted(self, session: int, health: Mapping[str, Any]) -> list[Alarm]:
        """Clears for the active alarms of an ended daemon, except those in the ``health`` of its successor.

        ``session`` is the start of the successor, UTC ns; the PC's clock may have been set back before it.
        """
        current = {body["id"] for key in ("alarms", "shelved") for body in health.get(key, ())}
        over = (standing.alarm for standing in self.raised if standing.alarm.id not in current)
        return [replace(a, active=False, time=max(session, a.time), statement=RESTARTED) for a in over]

    # damping --------------------------------------------------------------------------------------

    def _change(self, standing: Standing, time: int) -> None:
        """Reverse ``holds``: the condition has appeared or ended."""
        standing.holds, standing.changed, standing.streak = not standing.holds, time, 0
        if self._damping is not None:
            recent = (at for at in standing.raises if time - at < self._span)
            standing.raises = (*recent, time) if standing.holds else tuple(recent)
            if not standing.holds and (standing.flaps or len(standing.raises) > self._damping.times):
                standing.flaps += 1
        if not standing.raised:
            standing.acknowledgement = None

    def _settle(self, standing: Standing, now: int) -> None:
        """End the damping of an alarm that has been steady for the span."""
        if standing.flaps and now - standing.changed >= self._span:
            if standing.over is not None and not standing.holds:
                evidence = {**standing.over.evidence, "flaps": standing.flaps}
                standing.over, standing.acknowledgement = replace(standing.over, evidence=evidence), None
            standing.flaps = 0

    def _forget(self, standing: Standing, now: int) -> None:
        """Delete the state of a cleared alarm that neither a message, a shelf nor damping needs."""
        needed = standing.raised or standing.published or standing.shelf or (standing.streak and not standing.over)
        if not needed and now - standing.changed >= self._span:
            del self._standing[standing.alarm.id]

    @property
    def _span(self) -> float:
        """Span of damping, ns."""
        return 0.0 if self._damping is None else self._damping.seconds * 1e9


def _fields(word: Acknowledgement | Shelf | None) -> dict[str, Any] | None:
    return None if word is None else asdict(word)


def _standings(state: Iterable[Any]) -> dict[str, Standing]:
    return {standing.alarm.id: standing for standing in _STATE.validate_python(list(state))}


def _plain(standings: Iterable[Standing]) -> list[Any]:
    found: list[Any] = pydantic_core.to_jsonable_python(list(standings))
    return found


def _published(standing: Standing, now: int) -> list[Alarm]:
    """The message to publish at ``now``; none if the shelf or damping holds it back, or its raise was not published."""
    message, before, shelf = standing.message, standing.published, standing.shelf
    if shelf is not None:
        graver = message.active and SEVERITIES.index(message.severity) > SEVERITIES.index(shelf.severity)
        if now < shelf.until and not graver:
            return []
        standing.shelf = None
    announced = before is not None and bool(before.evidence.get("flaps")) and before.severity == message.severity
    if (standing.flaps and announced) or (before is None and not standing.raised):
        return []
    message = replace(message, time=now)
    standing.published = message if message.active else None
    return [message]


def withdrawn(alarms: Iterable[Alarm], time: int, why: str) -> list[Alarm]:
    """Clears for ``alarms`` that their stage no longer observes, with the reason ``why``."""
    text = "Withdrawn, as stage {} {}: {}"
    return [replace(a, active=False, time=time, statement=text.format(a.stage, why, a.statement)) for a in alarms]
