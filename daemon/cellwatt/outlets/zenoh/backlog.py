"""The recent results that an outlet holds in memory for consumers that join late or missed some."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable

from cellwatt.outlet import Journal
from cellwatt.outlets.zenoh.keys import ALARM, alarm_path
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import topic_of
from cellwatt.record.messages import time_of
from cellwatt.results import Alarm, Event, Result

ALARMS_KEPT, RESULTS_KEPT = 4096, 1024
"""Numbers of alarms, and of results or events of each other topic, held in memory; the record has more."""


class Backlog:
    """Numbers results and events, and holds the latest of each topic and the active alarms.

    ``session`` is the start of this numbering, UTC ns: a new outlet begins a new session, so that no number is used
    twice; with a ``journal`` it continues the journal's numbering. ``up`` are active alarms.
    Called from several threads.
    """

    def __init__(self, session: int, journal: Journal | None = None, up: Iterable[Alarm] = ()) -> None:
        self.session = session
        self._lock = threading.Lock()
        self._kept: dict[str, deque[tuple[Mark, Result | Event]]] = {}
        self._alarms: dict[str, tuple[Mark, Alarm]] = {}
        self._journal = journal
        for number, item in journal.past() if journal is not None else ():
            self._keep(number, item)
        for alarm in up:  # the journal may no longer have its message
            self._alarms.setdefault(alarm.id, (Mark(session, 0, 1, alarm.time), alarm))

    @property
    def ends(self) -> dict[str, tuple[int, int]]:
        """Session and next number of each topic of results and events."""
        return {topic: (self.session, kept[-1][0].end) for topic, kept in self._kept.items()}

    def add(self, item: Result | Event) -> tuple[Mark, tuple[str, ...]]:
        """Number and hold a result or event; return its mark and the paths to publish it under.

        An alarm whose severity changed has two paths, so that subscribers of the old path receive it; all else has one.
        """
        with self._lock:
            return self._keep(None if self._journal is None else self._journal.put(item), item)

    def _keep(self, number: int | None, item: Result | Event) -> tuple[Mark, tuple[str, ...]]:
        """Hold an item under ``number``; ``None``: the next number of its topic."""
        topic = topic_of(item)
        if topic not in self._kept:
            self._kept[topic] = deque(maxlen=ALARMS_KEPT if topic == ALARM else RESULTS_KEPT)
        kept = self._kept[topic]
        if number is None:
            number = kept[-1][0].end if kept else 0
        mark = Mark(self.session, number, 1, time_of(item))
        kept.append((mark, item))
        return mark, self._set_alarm(mark, item) if isinstance(item, Alarm) else (topic,)

    def active(self) -> list[tuple[Mark, Alarm]]:
        """Active alarms, oldest first."""
        with self._lock:
            return list(self._alarms.values())

    def cleared(self, count: int) -> list[tuple[Mark, Alarm]]:
        """The last ``count`` cleared alarms, oldest first."""
        with self._lock:
            kept = list(self._kept.get(ALARM, ()))
        found = [(mark, alarm) for mark, alarm in kept if isinstance(alarm, Alarm) and not alarm.active]
        return found[-count:] if count > 0 else []

    def results(self, topic: str, session: int, first: int, count: int) -> list[tuple[Mark, Result | Event]]:
        """Results ``first`` … ``first + count`` of a topic that are still in memory."""
        with self._lock:
            kept = self._kept.get(topic, ()) if session == self.session else ()
            return [(m, r) for m, r in kept if first <= m.sequence < first + count]

    def _set_alarm(self, mark: Mark, alarm: Alarm) -> tuple[str, ...]:
        before = self._alarms.pop(alarm.id, (mark, alarm))[1]
        if alarm.active:
            self._alarms[alarm.id] = (mark, alarm)
        return tuple(dict.fromkeys(alarm_path(a.severity, a.kind) for a in (alarm, before)))
