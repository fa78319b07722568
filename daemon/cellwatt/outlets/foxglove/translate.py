"""Converts the messages of a cell to messages for the Foxglove app."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from cellwatt.alarms import FollowedAlarms
from cellwatt.frames import Frames, Layout
from cellwatt.outlets.foxglove.topics import (
    JSON_TOPICS,
    Moment,
    Outgoing,
    Topic,
    log_topic,
    own,
)
from cellwatt.outlets.zenoh.received import Health
from cellwatt.protobuf import file_descriptor_set
from cellwatt.record import messages
from cellwatt.record.encoder import FRAME_TOPIC, PACKAGE
from cellwatt.record.rows import FRAME_FIELDS, FRAMING, FrameRows, value_fields
from cellwatt.results import Alarm, Energy, Event, Interval, Result, Task

_BODY: Final = np.dtype(FRAMING).itemsize
"""Number of bytes of a row before the message."""


_LEVELS: Final = {"info": "Info", "warning": "Warning", "error": "Error"}


class Translator:
    """Converts frames, results, events and health to messages."""

    def __init__(self) -> None:
        self._rows: FrameRows | None = None
        self._alarms = FollowedAlarms()
        self._session: int | None = None
        self._log = log_topic()

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Topics known before any message; the topic of the frames is created with the first frame."""
        return (*JSON_TOPICS.values(), self._log)

    def frames(self, frames: Frames) -> Iterator[Moment]:
        """One moment for each frame of a block."""
        if self._rows is None or self._rows.layout != frames.layout:
            self._rows = FrameRows(frames.layout)
            self._topic = _frame_topic(frames.layout)
        rows = self._rows.encode(frames, 0)
        data, size = rows.tobytes(), rows.dtype.itemsize
        for i, time in enumerate(frames.time.tolist()):
            outgoing = Outgoing(self._topic, time, data[i * size + _BODY : (i + 1) * size])
            yield Moment(time, (outgoing,), frames.layout.step / 1e9)

    def item(self, item: Result | Event | messages.Health) -> Moment:
        """The moment of a result, an event or health."""
        time = messages.time_of(item)
        over = isinstance(item, Alarm) and not item.active
        outgoing = [Outgoing(JSON_TOPICS[type(item)], time, messages.encode(item), _key(item), over)]
        if isinstance(item, Event):
            outgoing.append(Outgoing(self._log, time, _line(time, "Info", item.text, item.source or "cellwatt")))
        elif isinstance(item, Alarm) and self._alarms.hear(item).news:
            level = _LEVELS[item.severity] if item.active else "Info"
            line = _line(time, level, item.statement, item.source or item.stage or "cellwatt")
            outgoing.append(Outgoing(self._log, time, line, _key(item), over))
        return Moment(time, tuple(outgoing))

    def session(self, health: Health) -> Iterator[Moment]:
        """Note the session of the cell's daemon; clear the alarms that only an ended daemon had raised."""
        before, self._session = self._session, health.session
        if before not in (None, health.session):
            yield from map(self.item, self._alarms.restarted(health.session, health.status))

    def lost(self, time: int, topic: str, count: int) -> Moment:
        """A log message at ``time``, UTC ns: ``count`` samples or results of a topic are lost."""
        text = f"{count} of {topic} are lost: the cell no longer stores them"
        return Moment(time, (Outgoing(self._log, time, _line(time, "Warning", text, "cellwatt")),))


def _frame_topic(layout: Layout) -> Topic:
    fields = (*FRAME_FIELDS, *value_fields(layout.names, FRAME_FIELDS))
    return Topic(FRAME_TOPIC, "protobuf", f"{PACKAGE}.frame", file_descriptor_set(PACKAGE, "frame", fields))


def _key(item: Result | Event | messages.Health) -> str | None:
    """Name of the state that a message describes, if clients that subscribe later also need it."""
    match item:
        case Alarm():
            return item.id
        case Interval() | Task():
            return item.source
        case Energy():
            return f"{item.source}/{item.task}"
        case messages.Health():
            return "health"
    return None


def _line(time: int, level: str, text: str, name: str) -> bytes:
    kind, stamp = getattr(own().LogLevel, level), own().Timestamp(*divmod(time, 1_000_000_000))
    found: bytes = own().Log(timestamp=stamp, level=kind, message=text, name=name).encode()
    return found
