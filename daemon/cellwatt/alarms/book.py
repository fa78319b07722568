"""The alarm book: raises, updates and clears alarms by id, with patience, damping, acknowledgement and shelf.

Pure: times are arguments, UTC ns, and the same calls give the same alarms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import pydantic_core
from pydantic import TypeAdapter

from cellwatt.alarms.standing import SEVERITIES, Acknowledgement, Patience, Shelf, Standing, Standings
from cellwatt.errors import CellwattError
from cellwatt.results import Alarm

_STATE: Final = TypeAdapter(list[Standing])
AT_ONCE: Final = Patience()


@dataclass(frozen=True, slots=True)
class Damping:
    """An alarm raised more than ``times`` times in ``seconds`` stays raised until it is steady for ``seconds``."""

    times: int = 5
    seconds: float = 600.0


class AlarmBook(Standings):
    """Alarms of one stage or of a whole cell; without ``damping`` each follows its condition.

    Methods that change an alarm return the messages to publish.
    """

    def __init__(self, damping: Damping | None = None) -> None:
        super().__init__()
        self._damping = damping
        self._expected: dict[str, Standing] = {}
        self._expected_until = 0

    def state(self) -> list[Any]:
        """The whole state of the book, JSON-ready."""
        return _plain(self._standing.values())

    def words(self) -> list[Any]:
        """State of the acknowledged and shelved alarms."""
        return _plain(s for s in self._standing.values() if s.acknowledgement or s.shelf)

    def adopt(self, state: Iterable[Any]) -> None:
        """Add the alarms of ``state``, that of another book; they replace alarms with the same ids."""
        self._standing |= _standings(state)

    def expect(self, words: Iterable[Any], until: int) -> None:
        """Restore the acknowledgements ``words`` of alarms that are raised before ``until`` ns.

        A shelf is restored if its alarm is raised before the shelf ends.
        """
        self._expected, self._expected_until = _standings(words), until

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

    def status(self) -> dict[str, Any]:
        """Active alarms with their acknowledgements, and shelved alarms, JSON-ready, for health."""
        alarms = [
            {**{k: getattr(s.published, k) for k in Alarm.__slots__}, "acknowledged": _fields(s.acknowledgement)}
            for s in self.up
        ]
        about = ("id", "kind", "severity", "statement", "since")
        shelved = [{**{k: getattr(s.alarm, k) for k in about}, "shelf": _fields(s.shelf)} for s in self.shelved]
        return {"alarms": alarms, "shelved": shelved}

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
