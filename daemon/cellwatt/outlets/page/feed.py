"""The state of one cell for browsers, whether its data come from the daemon or from the bus."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from typing import Any

from cellwatt.alarms import Standing
from cellwatt.batch import Batch
from cellwatt.frames import Frames, Layout
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.streams import Hub
from cellwatt.results import Energy, Event, Interval, Prediction, Result, Task, series_of
from cellwatt.subscriber import Gap, Health, Message


class Feed:
    """One cell: ``take…`` receive its messages in order of arrival, ``hub`` streams them, ``state`` is the state now.

    ``reports``: path at which its reports are served, ``""`` if they are not.
    """

    def __init__(self, site: str, cell: str, hub: Hub, reports: str = "") -> None:
        self.site, self.cell, self.hub = site, cell, hub
        self.live = LiveCell()
        self.layout: Layout | None = None
        self.arms: list[dict[str, Any]] = []
        self.laid_out = asyncio.Event()
        """Set when the channels of the frames become known or change."""
        self._reports = reports
        self._shelved: list[dict[str, Any]] = []
        """Shelved alarms as last sent to browsers."""

    # messages of the cell -------------------------------------------------------------------------

    def take(self, message: Message) -> None:
        """Receive a message from a subscriber."""
        content = message.content
        if isinstance(content, Frames):
            self.take_frames(content)
        elif isinstance(content, Health):
            before = self.live.session
            self.take_health(content.status, content.session)
            if before not in (None, self.live.session):
                self.hub.end()
        elif isinstance(content, Gap):
            self.live.add(content)
            self.take_gap(f"{content.count} of {message.topic} were lost: {content.reason}")
        elif not isinstance(content, Batch):
            self.take_item(content)

    def take_frames(self, frames: Frames) -> None:
        """Receive frames; a changed layout ends all streams, so that browsers request the state again."""
        if frames.layout != self.layout:
            changed = self.layout is not None
            self.layout = frames.layout
            self.laid_out.set()
            if changed:
                self.hub.end()
        self.live.add_frames(frames)
        self.hub.frames(frames)

    def take_item(self, item: Result | Event) -> None:
        """Receive a result or event."""
        alarms = self.live.add(item)
        match item:
            case Prediction():
                self.hub.prediction(item)
            case Interval() | Task() | Energy():
                self.hub.tell(series_of(item), shapes.span(item))
            case Event():
                self.hub.tell("event", shapes.event(item))
        self._tell_alarms(alarms)

    def take_health(self, status: Mapping[str, Any], session: int | None = None) -> None:
        """Receive the cell's health; its list of alarms overrides the alarm messages received before."""
        self._tell_alarms(self.live.add_health(status, session))
        self.hub.tell("health", status)

    def take_gap(self, text: str) -> None:
        """Report missing data to browsers."""
        self.hub.tell("gap", {"text": text})

    def _tell_alarms(self, alarms: Sequence[Standing]) -> None:
        """Send changed alarms to browsers, and the list of shelved alarms if it changed."""
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

    # current state --------------------------------------------------------------------------------

    @property
    def names(self) -> Sequence[str]:
        """Names of the frames' channels."""
        return () if self.layout is None else self.layout.names

    @property
    def joints(self) -> list[str]:
        """Channels of the joint positions of the arms."""
        return [joint["channel"] for arm in self.arms for joint in arm["joints"] if joint.get("channel")]

    def state(self) -> dict[str, Any]:
        """Complete state of the cell, ready for JSON."""
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
            "intervals": [shapes.span(interval) for interval in live.intervals],
            "task": None if live.task is None else shapes.span(live.task),
            "energies": {name: [shapes.span(energy) for energy in last] for name, last in live.energies.items()},
            "predictions": [
                {"model": model, "outputs": dict(zip(history.names, history.units, strict=True))}
                for model, history in live.predicted.items()
            ],
            "arms": self.arms,
        }
