"""The state of a cell, assembled from its messages."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from cellwatt.alarms import FollowedAlarms, Standing
from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.live.last_minute import LastMinute
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task
from cellwatt.subscriber import Gap

CLEARED: Final = 500
"""Number of cleared alarms that are stored."""
REPETITIONS: Final = 100
"""Number of cycles of a task whose energies are stored …"""
TASKS: Final = 64
"""… and number of tasks; beyond it, those of the task that ended first are discarded."""
SILENT: Final = 5.0
"""Time, s, without a message after which the cell counts as silent; it sends its health every second."""

_TOLD: Final = {"site", "cell", "state", "time", "sources", "recorder", "frames", "results"}

Body = Mapping[str, Any]


@dataclass
class LiveCell:
    """State of a cell, updated by ``add``, ``add_frames`` and ``add_health`` with its messages in order of arrival.

    ``alarms``: the alarms of received messages; ``cleared``: the last cleared alarms; ``forgotten``: number of
    older cleared alarms, discarded; ``predicted``: outputs of models, by model; ``heard``: monotonic time, s, of the
    last message.
    """

    status: Body = field(default_factory=dict)
    session: int | None = None
    restarts: int = 0
    alarms: FollowedAlarms = field(default_factory=FollowedAlarms)
    cleared: deque[Standing] = field(default_factory=lambda: deque(maxlen=CLEARED))
    forgotten: int = 0
    intervals: deque[Interval] = field(default_factory=lambda: deque(maxlen=32))
    task: Task | None = None
    energies: dict[str, deque[Energy]] = field(default_factory=dict)
    frames: LastMinute = field(default_factory=LastMinute)
    predicted: dict[str, LastMinute] = field(default_factory=dict)
    heard: float | None = None
    heard_at: int = 0
    """UTC time of the last message, ns."""

    def add(self, item: Result | Event | Batch | Frames | Gap) -> list[Standing]:
        """Update the state from a result or event; return the alarms it concerns.

        Any other content of a message only shows that the cell is there.
        """
        self._alive()
        match item:
            case Alarm():
                return self._over([self.alarms.hear(item)])
            case Event():
                return self.alarms.note(item)
            case Interval(closed=True):
                self.intervals.append(item)
            case Task():
                self.task = item
            case Energy():
                self.energies.setdefault(item.task, deque(maxlen=REPETITIONS)).append(item)
                if len(self.energies) > TASKS:
                    del self.energies[min(self.energies, key=lambda name: self.energies[name][-1].end)]
            case Prediction():
                self._prediction(item)
        return []

    def add_health(self, status: Body, session: int | None = None) -> list[Standing]:
        """Update the state from the cell's health; return the alarms it concerns.

        Another ``session`` than before ends alarms and tasks of the daemon before it.
        """
        self._alive()
        ended = [] if session is None else self._session(session, status)
        return [*ended, *self._health(status)]

    def add_frames(self, frames: Frames) -> None:
        """Store the values of frames."""
        self._alive()
        units = [channel.unit for channel in frames.layout.channels]
        self.frames.add(frames.time, frames.layout.names, units, frames.values)

    @property
    def state(self) -> str:
        """The worse of the daemon's own state and the state of its alarms, as on the page.

        An unacknowledged error is ``red``, any other error or warning ``amber``; shelved alarms do not count.
        """
        own = str(self.status["state"])
        grave = [standing for standing in self.alarms.up if standing.alarm.severity != "info"]
        if own == "red" or any(s.alarm.severity == "error" and s.acknowledgement is None for s in grave):
            return "red"
        return "amber" if grave else own

    def silent_for(self, now: float) -> float | None:
        """Time, s, from the last message to monotonic time ``now`` if it is at least ``SILENT``, else None."""
        gone = 0.0 if self.heard is None else now - self.heard
        return gone if gone >= SILENT else None

    def _alive(self) -> None:
        self.heard, self.heard_at = time.monotonic(), time.time_ns()

    def _health(self, status: Body) -> list[Standing]:
        if not status.keys() >= _TOLD:
            return []  # not a health message, or one of another version
        self.status = status
        return self._over(self.alarms.agree(status))

    def _session(self, session: int, status: Body) -> list[Standing]:
        """On a new session, clear the alarms of the ended daemon that the new daemon does not list in ``status``.

        Its tasks are forgotten, as the new daemon gives their names to other motions.
        """
        known, self.session = self.session, session
        if known in (None, session):
            return []
        self.restarts += 1
        self.status, self.task, self.energies = {}, None, {}
        before, self.alarms = self.alarms, FollowedAlarms()
        return self._over([before.hear(clear) for clear in before.restarted(session, status)])

    def _over(self, alarms: list[Standing]) -> list[Standing]:
        """Store the cleared alarms among ``alarms``; return all ``alarms``."""
        for standing in alarms:
            if not standing.raised:
                self.forgotten += len(self.cleared) == CLEARED
                self.cleared.append(standing)
        return alarms

    def _prediction(self, item: Prediction) -> None:
        names = tuple(item.outputs)
        values = np.array([item.outputs[name] for name in names]).T.reshape(len(item.time), len(names))
        units = [item.units[name] for name in names]
        self.predicted.setdefault(item.model, LastMinute()).add(np.array(item.time, np.int64), names, units, values)
