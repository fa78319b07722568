"""The recent messages that an outlet keeps for consumers that join late or missed some."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Final

from cellwatt.frames import Frames
from cellwatt.outlet import Journal
from cellwatt.outlets.zenoh.keys import ALARM, alarm_path
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import topic_of
from cellwatt.record.messages import time_of
from cellwatt.results import Alarm, Event, Result

ALARMS_KEPT, RESULTS_KEPT = 4096, 1024
"""Alarms, and results and events of each other topic, that are kept; the record has more."""
_OVERHEAD: Final = 1000
"""Bytes that a block of frames takes in memory beside its numbers: of two frames, more than these."""


class Backlog:
    """Numbers results and events, and keeps the last of each, of the frames, and the alarms that are active now.

    ``session`` is the start of this numbering, UTC ns: an outlet that is made anew begins a new one, so that a number
    is never given twice; with a ``journal`` it goes on with the numbering there. Frames have the cell's own numbers,
    in the cell's session ``numbered``, which is ``session`` by default; they are kept up to ``frame_bytes``. Called
    from several threads.
    """

    def __init__(
        self, session: int, frame_bytes: float, journal: Journal | None = None, numbered: int | None = None
    ) -> None:
        self.session = session
        self._numbered = session if numbered is None else numbered
        self._lock = threading.Lock()
        self._kept: dict[str, deque[tuple[Mark, Result | Event]]] = {}
        self._alarms: dict[str, tuple[Mark, Alarm]] = {}
        self._frames: deque[Frames] = deque()
        self._frame_bytes = 0
        self._most_bytes = frame_bytes
        self._journal = journal
        for number, item in journal.past() if journal is not None else ():
            self._keep(number, item)

    def add(self, item: Result | Event) -> tuple[Mark, tuple[str, ...]]:
        """Number and keep a result or event; return its mark and the paths to publish it under.

        There is one path, or two for an alarm whose severity changed: subscribers of the old path must hear of it.
        """
        with self._lock:
            return self._keep(None if self._journal is None else self._journal.put(item), item)

    def _keep(self, number: int | None, item: Result | Event) -> tuple[Mark, tuple[str, ...]]:
        """``number`` is the item's, ``None`` for the next of its topic."""
        topic = topic_of(item)
        if topic not in self._kept:
            self._kept[topic] = deque(maxlen=ALARMS_KEPT if topic == ALARM else RESULTS_KEPT)
        kept = self._kept[topic]
        if number is None:
            number = kept[-1][0].end if kept else 0
        mark = Mark(self.session, number, 1, time_of(item))
        kept.append((mark, item))
        return mark, self._set_alarm(mark, item) if isinstance(item, Alarm) else (topic,)

    def add_frames(self, frames: Frames) -> Mark:
        """Keep frames under their own numbers."""
        mark = Mark(self._numbered, frames.sequence, len(frames), int(frames.time[-1]) if len(frames) else 0)
        with self._lock:
            self._frames.append(frames)
            self._frame_bytes += _size(frames)
            while self._frame_bytes > self._most_bytes and len(self._frames) > 1:
                self._frame_bytes -= _size(self._frames.popleft())
        return mark

    def succeed(self, before: Backlog) -> None:
        """Keep the frames of another one that takes no more."""
        with before._lock, self._lock:
            if before._numbered == self._numbered:
                self._frames, self._frame_bytes = before._frames, before._frame_bytes

    def active(self) -> list[tuple[Mark, Alarm]]:
        """The alarms active now, oldest first."""
        with self._lock:
            return list(self._alarms.values())

    def cleared(self, count: int) -> list[tuple[Mark, Alarm]]:
        """The last ``count`` alarms that were cleared, oldest first."""
        with self._lock:
            kept = list(self._kept.get(ALARM, ()))
        found = [(mark, alarm) for mark, alarm in kept if isinstance(alarm, Alarm) and not alarm.active]
        return found[-count:] if count > 0 else []

    def results(self, topic: str, session: int, first: int, count: int) -> list[tuple[Mark, Result | Event]]:
        """Results ``first`` … ``first + count`` of a topic that are still kept."""
        with self._lock:
            kept = self._kept.get(topic, ()) if session == self.session else ()
            return [(m, r) for m, r in kept if first <= m.sequence < first + count]

    def frames(self, session: int, first: int, count: int) -> Sequence[Frames]:
        """The kept blocks that hold any of the frames ``first`` … ``first + count``."""
        with self._lock:
            kept = self._frames if session == self._numbered else ()
            return [f for f in kept if f.sequence + len(f) > first < first + count > f.sequence]

    def _set_alarm(self, mark: Mark, alarm: Alarm) -> tuple[str, ...]:
        before = self._alarms.pop(alarm.id, (mark, alarm))[1]
        if alarm.active:
            self._alarms[alarm.id] = (mark, alarm)
        return tuple(dict.fromkeys(alarm_path(a.severity, a.kind) for a in (alarm, before)))


def _size(frames: Frames) -> int:
    numbers = frames.time.nbytes + frames.values.nbytes + frames.quality.nbytes + frames.bound.nbytes
    return numbers + _OVERHEAD
