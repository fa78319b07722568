"""The alarms of a cell as its messages, events and health report them. Pure, as the alarm book."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from pydantic import TypeAdapter

from cellwatt.alarms.standing import Acknowledgement, Shelf, Standing, Standings
from cellwatt.results import Alarm

LOST: Final = "Cleared; the message with the reason was not received."
"""Statement of the clear of an alarm that the cell no longer lists, although its own clear was not received."""
RESTARTED: Final = "The daemon ended while this alarm was active; after its restart it raises alarms that still hold."
"""Statement of the clear of an alarm that was active when the daemon ended."""
_ALARM: Final = TypeAdapter(Alarm)
_CLEARS: Final = 500
"""Number of clears whose time is stored, so that an older health message does not raise their alarms again."""


class FollowedAlarms(Standings):
    """Alarms of the book of another process, by its messages (``hear``), events (``note``) and health (``agree``)."""

    def __init__(self) -> None:
        super().__init__()
        self._over: dict[str, int] = {}
        """Times of the clears received, ns, by alarm id."""

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
