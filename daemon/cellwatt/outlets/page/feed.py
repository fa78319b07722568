"""The state of one cell for browsers, from whichever way its data come."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from cellwatt.alarms import Standing
from cellwatt.batch import Batch
from cellwatt.frames import Frames, Layout
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.streams import Hub
from cellwatt.results import Event
from cellwatt.subscriber import Gap, Health, Message

Body = Mapping[str, Any]


class Feed:
    """One cell: ``take…`` takes what it tells in order of arrival, ``hub`` passes it on, ``state`` is all of it now.

    ``reports`` is where its reports are served, empty if nowhere.
    """

    def __init__(self, site: str, cell: str, hub: Hub, reports: str = "") -> None:
        self.site, self.cell, self.hub = site, cell, hub
        self.live = LiveCell()
        self.layout: Layout | None = None
        self.arms: list[dict[str, Any]] = []
        self.laid_out = asyncio.Event()
        """Set when the columns of the frames are known, or others."""
        self._reports = reports
        self._shelved: list[dict[str, Any]] = []
        """As browsers were told."""

    # what the cell tells --------------------------------------------------------------------------

    def take(self, message: Message) -> None:
        """Take a message of a subscriber."""
        content = message.content
        if isinstance(content, Frames):
            self.take_frames(content)
        elif isinstance(content, Health):
            before = self.live.session
            self._tell_health(self.live.take(message), content.status)
            if before not in (None, self.live.session):
                self.hub.end()
        elif isinstance(content, Gap):
            self.live.take(message)
            self.take_gap(f"{content.count} of {message.topic} were lost: {content.reason}")
        elif not isinstance(content, Batch):
            self.take_item("event" if isinstance(content, Event) else message.topic.partition("/")[0], asdict(content))

    def take_frames(self, frames: Frames) -> None:
        """Take frames; other columns than before end all streams, whose browsers then ask for the state again."""
        if frames.layout != self.layout:
            changed = self.layout is not None
            self.layout = frames.layout
            self.laid_out.set()
            if changed:
                self.hub.end()
        self.live.add_frames(frames)
        self.hub.frames(frames)

    def take_item(self, kind: str, body: Body) -> None:
        """Take a result or event as its fields; ``kind`` is the first part of its topic."""
        alarms = self.live.add(kind, body)
        if kind == "prediction":
            self.hub.prediction(body)
        elif kind in ("interval", "task", "energy"):
            self.hub.tell(kind, shapes.span(kind, body))
        elif kind == "event":
            self.hub.tell(kind, shapes.event(body))
        self._tell_alarms(alarms)

    def take_health(self, status: Body) -> None:
        """Take the cell's health; where alarms in it are others than those that were heard, it is right."""
        self._tell_health(self.live.add("health", status), status)

    def _tell_health(self, alarms: Sequence[Standing], status: Body) -> None:
        self._tell_alarms(alarms)
        self.hub.tell("health", status)

    def take_gap(self, text: str) -> None:
        """Tell browsers that something did not come."""
        self.hub.tell("gap", {"text": text})

    def _tell_alarms(self, alarms: Sequence[Standing]) -> None:
        """Tell browsers of alarms that are others than before, and which are on the shelf."""
        for standing in alarms:
            if standing.shelf is None:
                self.hub.tell("alarm", self._alarm(standing))
        shelved = [shapes.shelved(standing) for standing in self.live.alarms.shelved]
        if shelved != self._shelved:
            self._shelved = shelved
            self.hub.tell("shelved", shelved)

    def _alarm(self, standing: Standing) -> dict[str, Any]:
        pack = standing.evidence
        page = f"{self._reports}/evidence/{pack.removesuffix('.mcap')}.html" if pack and self._reports else None
        return shapes.alarm(standing.message, standing.acknowledgement, page)

    # all of it now --------------------------------------------------------------------------------

    def is_up(self, alarm_id: str) -> bool:
        """True if an alarm is active, or on the shelf."""
        return alarm_id in self.live.alarms

    def is_shelved(self, alarm_id: str) -> bool:
        """True if an alarm is on the shelf."""
        return self.is_up(alarm_id) and self.live.alarms[alarm_id].shelf is not None

    @property
    def names(self) -> Sequence[str]:
        """Names of the frames' channels."""
        return () if self.layout is None else self.layout.names

    @property
    def joints(self) -> list[str]:
        """Channels that move the arms."""
        return [joint["channel"] for arm in self.arms for joint in arm["joints"] if joint.get("channel")]

    def state(self) -> dict[str, Any]:
        """All that is known of the cell, JSON-ready."""
        live = self.live
        age = None if live.heard is None else time.monotonic() - live.heard
        return {
            "time": shapes.ms(live.status.get("time")),
            "session": shapes.ms(live.session),
            "status": live.status,
            "heard_age_s": age,
            "channels": [] if self.layout is None else shapes.channels(self.layout),
            "alarms": [self._alarm(standing) for standing in live.alarms.up],
            "shelved": self._shelved,
            "intervals": [shapes.span("interval", body) for body in live.intervals],
            "task": None if live.task is None else shapes.span("task", live.task),
            "energies": {name: [shapes.span("energy", e) for e in kept] for name, kept in live.energies.items()},
            "predictions": [
                {"model": model, "outputs": dict(zip(history.names, history.units, strict=True))}
                for model, history in live.predicted.items()
            ],
            "arms": self.arms,
        }
