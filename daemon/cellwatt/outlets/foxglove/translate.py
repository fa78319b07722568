"""What a cell tells, as messages for the Foxglove app."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from cellwatt.alarms import AlarmBook
from cellwatt.frames import Frames, Layout
from cellwatt.outlets.foxglove.arm import Arms
from cellwatt.outlets.foxglove.topics import (
    KINDS,
    LOG,
    SCENE,
    TRANSFORMS,
    Moment,
    Outgoing,
    Topic,
    drawn_topic,
    json_topic,
    own,
    stamp_of,
)
from cellwatt.protobuf import file_descriptor_set
from cellwatt.record import messages
from cellwatt.record.encoder import FRAME_TOPIC, PACKAGE
from cellwatt.record.rows import FRAME_FIELDS, FRAMING, FrameRows, value_fields
from cellwatt.results import Alarm, Energy, Event, Interval, Result, Task

_BODY: Final = np.dtype(FRAMING).itemsize
"""Bytes of a row before the message itself."""


class FrameMessages:
    """The topic of the frames of one layout, and its messages."""

    def __init__(self, layout: Layout) -> None:
        fields = value_fields(layout.names, FRAME_FIELDS)
        self.layout = layout
        self.topic = Topic(
            FRAME_TOPIC,
            "protobuf",
            f"{PACKAGE}.frame",
            file_descriptor_set(PACKAGE, "frame", (*FRAME_FIELDS, *fields)),
        )
        self._rows = FrameRows(layout)

    def of(self, frames: Frames) -> Iterator[bytes]:
        """One message for each frame of a block."""
        rows = self._rows.encode(frames, 0)
        data, size = rows.tobytes(), rows.dtype.itemsize
        for start in range(0, len(data), size):
            yield data[start + _BODY : start + size]


Skeletons = Callable[[Layout], Sequence[Mapping[str, Any]]]

_FASTEST: Final = 50.0
"""Transforms a second, at most: the eye sees no more."""
_LEVELS: Final = {"info": "Info", "warning": "Warning", "error": "Error"}


class Translator:
    """Turns frames, results, events and health into messages; ``skeletons`` gives the arms for a layout, if any."""

    def __init__(self, skeletons: Skeletons | None = None) -> None:
        self._skeletons = skeletons
        self._frames: FrameMessages | None = None
        self._arms: Arms | None = None
        self._moved = -math.inf
        self._alarms = AlarmBook()
        self._log = drawn_topic(LOG, "Log")

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Topics that there are before anything was told; that of the frames comes with the first."""
        drawn = (drawn_topic(TRANSFORMS, "FrameTransforms"), drawn_topic(SCENE, "SceneUpdate"))
        known = (*map(json_topic, KINDS), self._log)
        return known if self._skeletons is None else (*known, *drawn)

    def frames(self, frames: Frames) -> Iterator[Moment]:
        """One moment for each frame of a block."""
        new = self._frames is None or self._frames.layout != frames.layout
        if new:
            self._frames = FrameMessages(frames.layout)
            self._arms = None if self._skeletons is None else Arms(self._skeletons(frames.layout))
        assert self._frames is not None
        for i, data in enumerate(self._frames.of(frames)):
            time = int(frames.time[i])
            told = [Outgoing(self._frames.topic, time, data)]
            if new and self._arms is not None:
                told.append(self._arms.links(time))
                new = False
            if self._arms is not None and time - self._moved >= 1e9 / _FASTEST - 1:
                self._moved = time
                told.append(self._arms.at(time, dict(zip(frames.layout.names, frames.values[i].tolist(), strict=True))))
            yield Moment(time, tuple(told), frames.layout.step / 1e9)

    def item(self, item: Result | Event | messages.Health) -> Moment:
        """The moment of a result, an event or health."""
        time = messages.time_of(item)
        over = isinstance(item, Alarm) and not item.active
        told = [Outgoing(json_topic(type(item)), time, messages.encode(item), _key(item), over)]
        if isinstance(item, Event):
            told.append(Outgoing(self._log, time, _line(time, "Info", item.text, item.source or "cellwatt")))
        elif isinstance(item, Alarm) and self._alarms.hear(item).news:
            level = _LEVELS[item.severity] if item.active else "Info"
            line = _line(time, level, item.statement, item.source or item.stage or "cellwatt")
            told.append(Outgoing(self._log, time, line, _key(item), over))
        return Moment(time, tuple(told))

    def lost(self, time: int, topic: str, count: int) -> Moment:
        """The moment at which it became known that samples or results of a topic are lost for ever."""
        text = f"{count} of {topic} did not arrive: the cell no longer has them"
        return Moment(time, (Outgoing(self._log, time, _line(time, "Warning", text, "cellwatt")),))


def _key(item: Result | Event | messages.Health) -> str | None:
    """Name of what a message tells the state of, if it is for those who come later as well."""
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
    kind = getattr(own().LogLevel, level)
    found: bytes = own().Log(timestamp=stamp_of(time), level=kind, message=text, name=name).encode()
    return found
