"""The state of a cell as its messages tell it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from cellwatt.alarms import RESTARTED, AlarmBook, Standing
from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.live.last_minute import LastMinute
from cellwatt.results import Event
from cellwatt.subscriber import Gap, Health, Message

CLEARED: Final = 500
"""Alarms that are remembered after they were cleared."""
REPETITIONS: Final = 100
"""Repetitions of a task whose energies are remembered."""
SILENT: Final = 5.0
"""s without a message after which the cell counts as silent; health comes each second."""

_TOLD: Final = {"site", "cell", "state", "time", "sources", "recorder", "frames", "results"}

Body = Mapping[str, Any]


@dataclass
class LiveCell:
    """State of a cell; ``take`` and ``add`` take its messages in order of arrival.

    ``alarms`` is the cell's book as it was heard; ``cleared`` are those that are over, ``forgotten`` counts older ones.
    ``predicted`` are the outputs of models, by model. ``heard`` is the monotonic time of the last message.
    """

    status: Body = field(default_factory=dict)
    session: int | None = None
    restarts: int = 0
    alarms: AlarmBook = field(default_factory=AlarmBook)
    cleared: deque[Standing] = field(default_factory=lambda: deque(maxlen=CLEARED))
    forgotten: int = 0
    intervals: deque[Body] = field(default_factory=lambda: deque(maxlen=32))
    task: Body | None = None
    energies: dict[str, deque[Body]] = field(default_factory=dict)
    frames: LastMinute = field(default_factory=LastMinute)
    predicted: dict[str, LastMinute] = field(default_factory=dict)
    heard: float | None = None
    heard_at: int = 0
    """UTC time of the last message, ns."""

    def take(self, message: Message) -> list[Standing]:
        """Take a message of a subscriber; give the alarms of which it says something."""
        content = message.content
        if isinstance(content, Gap):
            self._alive()
        elif isinstance(content, Frames):
            self.add_frames(content)
        elif isinstance(content, Health):
            return [*self._session(content.session), *self.add("health", content.status)]
        elif not isinstance(content, Batch):
            return self.add(message.topic.split("/", 1)[0], asdict(content))
        return []

    def add(self, kind: str, body: Body) -> list[Standing]:
        """Take a health message, a result or an event as its fields; give the alarms of which it says something."""
        self._alive()
        if kind == "health":
            return self._health(body)
        if kind == "alarm":
            return self._over([self.alarms.hear(body)])
        if kind == "event":
            return self.alarms.note(Event(**body))
        if kind == "interval" and body["closed"]:
            self.intervals.append(body)
        elif kind == "task":
            self.task = body
        elif kind == "energy":
            self.energies.setdefault(body["task"], deque(maxlen=REPETITIONS)).append(body)
        elif kind == "prediction":
            self._prediction(body)
        return []

    def add_frames(self, frames: Frames) -> None:
        """Take frames."""
        self._alive()
        units = [channel.unit for channel in frames.layout.channels]
        self.frames.add(frames.time, frames.layout.names, units, frames.values)

    @property
    def state(self) -> str:
        """The worse of the daemon's own state and what alarms say, as the page has it.

        An error that nobody has acknowledged is ``red``, any other error or warning ``amber``; the shelf is silent.
        """
        own = str(self.status["state"])
        grave = [standing for standing in self.alarms.up if standing.alarm.severity != "info"]
        if own == "red" or any(s.alarm.severity == "error" and s.acknowledgement is None for s in grave):
            return "red"
        return "amber" if grave else own

    def silent_for(self, now: float) -> float | None:
        """Time in s since the last message, at monotonic time ``now``, once it is too long."""
        gone = 0.0 if self.heard is None else now - self.heard
        return gone if gone >= SILENT else None

    def _alive(self) -> None:
        self.heard, self.heard_at = time.monotonic(), time.time_ns()

    def _health(self, status: Body) -> list[Standing]:
        if not status.keys() >= _TOLD:
            return []  # a cell of another version, or none
        self.status = status
        return self._over(self.alarms.agree(status))

    def _session(self, session: int) -> list[Standing]:
        """Forget the alarms of a daemon that has ended: the new one raises again what still holds."""
        before, self.session = self.session, session
        if before in (None, session):
            return []
        self.restarts += 1
        self.status = {}
        left, self.alarms = self.alarms, AlarmBook()
        ends = (replace(s.alarm, active=False, time=session, statement=RESTARTED) for s in left.raised)
        return self._over([left.hear(end) for end in ends])

    def _over(self, alarms: list[Standing]) -> list[Standing]:
        """Remember those that are over; give all."""
        for standing in alarms:
            if not standing.raised:
                self.forgotten += len(self.cleared) == CLEARED
                self.cleared.append(standing)
        return alarms

    def _prediction(self, body: Body) -> None:
        names = tuple(body["outputs"])
        values = np.array([[np.nan if v is None else v for v in body["outputs"][name]] for name in names]).T
        units = [body["units"][name] for name in names]
        self.predicted.setdefault(body["model"], LastMinute()).add(
            np.array(body["time"], np.int64), names, units, values.reshape(len(body["time"]), len(names))
        )
