"""The state of a cell as its messages tell it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.live.history import History
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

    ``alarms`` are active, by id; ``cleared`` are those of this session that no longer are, ``forgotten`` counts older
    ones. ``predicted`` are the outputs of models, by model. ``heard`` is the monotonic time of the last message.
    """

    status: Body = field(default_factory=dict)
    session: int | None = None
    restarts: int = 0
    alarms: dict[str, Body] = field(default_factory=dict)
    cleared: deque[Body] = field(default_factory=lambda: deque(maxlen=CLEARED))
    forgotten: int = 0
    intervals: deque[Body] = field(default_factory=lambda: deque(maxlen=32))
    task: Body | None = None
    energies: dict[str, deque[Body]] = field(default_factory=dict)
    frames: History = field(default_factory=History)
    predicted: dict[str, History] = field(default_factory=dict)
    lost: int = 0
    """Samples and results that were lost for ever on the way to us."""
    heard: float | None = None
    heard_at: int = 0
    """UTC time of the last message, ns."""

    def take(self, message: Message) -> None:
        """Take a message of a subscriber."""
        content = message.content
        if isinstance(content, Gap):
            self.lost += content.count
            self._alive()
        elif isinstance(content, Frames):
            self.add_frames(content)
        elif isinstance(content, Health):
            self._session(content.session)
            self.add("health", content.status)
        elif not isinstance(content, Batch | Event):
            self.add(message.topic.split("/", 1)[0], asdict(content))

    def add(self, kind: str, body: Body) -> None:
        """Take a message of kind health, alarm, interval, task, energy or prediction; others are ignored."""
        self._alive()
        if kind == "health":
            self._health(body)
        elif kind == "alarm":
            self._alarm(body)
        elif kind == "interval" and body["closed"]:
            self.intervals.append(body)
        elif kind == "task":
            self.task = body
        elif kind == "energy":
            self.energies.setdefault(body["task"], deque(maxlen=REPETITIONS)).append(body)
        elif kind == "prediction":
            self._prediction(body)

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
        known = {alarm["id"] for alarm in self.status.get("alarms", ()) if alarm.get("acknowledged")}
        shelved = {alarm["id"] for alarm in self.status.get("shelved", ())}
        grave = [a for a in self.alarms.values() if a["severity"] != "info" and a["id"] not in shelved]
        if own == "red" or any(a["severity"] == "error" and a["id"] not in known for a in grave):
            return "red"
        return "amber" if grave else own

    def silent_for(self, now: float) -> float | None:
        """Time in s since the last message, at monotonic time ``now``, once it is too long."""
        gone = 0.0 if self.heard is None else now - self.heard
        return gone if gone >= SILENT else None

    def _alive(self) -> None:
        self.heard, self.heard_at = time.monotonic(), time.time_ns()

    def _health(self, status: Body) -> None:
        if not status.keys() >= _TOLD:
            return  # a cell of another version, or none
        if not self.status:
            for alarm in status.get("alarms", ()):
                self.alarms.setdefault(alarm["id"], alarm)
        self.status = status

    def _session(self, session: int) -> None:
        """Forget the alarms of a daemon that has ended: the new one raises again what still holds."""
        if self.session not in (None, session):
            self.restarts += 1
            for alarm in self.alarms.values():
                self._clear({**alarm, "active": False, "time": session})
            self.alarms.clear()
            self.status = {}
        self.session = session

    def _alarm(self, alarm: Body) -> None:
        before = self.alarms.pop(alarm["id"], None)
        if alarm["active"]:
            self.alarms[alarm["id"]] = alarm
        elif before is not None:
            # The clear says why it was cleared; what was wrong, and the evidence, stand in the alarm itself.
            self._clear({**before, "active": False, "time": alarm["time"], "cleared": alarm["statement"]})
        else:
            self._clear(alarm)

    def _clear(self, alarm: Body) -> None:
        self.forgotten += len(self.cleared) == CLEARED
        self.cleared.append(alarm)

    def _prediction(self, body: Body) -> None:
        names = tuple(body["outputs"])
        values = np.array([[np.nan if v is None else v for v in body["outputs"][name]] for name in names]).T
        units = [body["units"][name] for name in names]
        self.predicted.setdefault(body["model"], History()).add(
            np.array(body["time"], np.int64), names, units, values.reshape(len(body["time"]), len(names))
        )
