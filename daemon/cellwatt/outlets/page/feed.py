"""The state of one cell for browsers, from whichever way its data come."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames, Layout
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.streams import Hub
from cellwatt.results import Event
from cellwatt.subscriber import Gap, Health, Message

Body = Mapping[str, Any]
MOST_PACKS: Final = 1000
"""Alarms whose evidence is remembered."""
LOST: Final = "It is over; the message that says why did not get here."
"""Statement of an alarm that the cell no longer has, though nobody heard it cleared."""


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
        self._acknowledged: dict[str, Body] = {}
        self._evidence: dict[str, str] = {}

    # what the cell tells --------------------------------------------------------------------------

    def take(self, message: Message) -> None:
        """Take a message of a subscriber."""
        content = message.content
        if isinstance(content, Frames):
            self.take_frames(content)
        elif isinstance(content, Health):
            before = self.live.session
            self.live.take(message)
            if before not in (None, self.live.session):
                self._begin_anew()
            self.take_health(content.status)
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
        if kind == "event":
            self.hub.tell("event", shapes.event(body))
            self._note(body)
            return
        self.live.add(kind, body)
        if kind == "alarm":
            self._tell_alarm(body)
        elif kind == "prediction":
            self.hub.prediction(body)
        elif kind in ("interval", "task", "energy"):
            self.hub.tell(kind, getattr(shapes, kind)(body))

    def take_health(self, status: Body) -> None:
        """Take the cell's health; where alarms in it are others than those that were heard, it is right."""
        self.live.add("health", status)
        if "alarms" in status and "time" in status:
            self._agree(status)
        self.hub.tell("health", status)

    def take_gap(self, text: str) -> None:
        """Tell browsers that something did not come."""
        self.hub.tell("gap", {"text": text})

    def _begin_anew(self) -> None:
        """The daemon was started again."""
        self._acknowledged.clear()
        self.hub.end()

    def _agree(self, status: Body) -> None:
        told = {alarm["id"]: alarm for alarm in status["alarms"]}
        shelved = [shapes.shelved(body) for body in status.get("shelved", ())]
        shelf = {body["id"] for body in shelved}
        for alarm_id in [a for a, body in self.live.alarms.items() if a not in told and body["time"] <= status["time"]]:
            if alarm_id in shelf:
                del self.live.alarms[alarm_id]
            else:
                over = {**self.live.alarms[alarm_id], "active": False, "time": status["time"], "statement": LOST}
                self.take_item("alarm", over)
        before = self._acknowledged
        self._acknowledged = {a: body["acknowledged"] for a, body in told.items() if body.get("acknowledged")}
        for alarm_id, body in told.items():
            if alarm_id not in self.live.alarms:
                self.take_item("alarm", body)
            elif before.get(alarm_id) != self._acknowledged.get(alarm_id):
                self._tell_alarm(self.live.alarms[alarm_id])
        if shelved != self._shelved:
            self._shelved = shelved
            self.hub.tell("shelved", shelved)

    def _note(self, event: Body) -> None:
        """Note what an event says of alarms, before health does."""
        data = event.get("data") or {}
        if event["kind"] == "acknowledged" and (body := self.live.alarms.get(str(data.get("alarm")))):
            self._acknowledged[body["id"]] = {"name": data["name"], "note": data["note"], "time": event["time"]}
            self._tell_alarm(body)
        if event["kind"] == "evidence" and "pack" in data:
            for alarm_id in data.get("alarms", ()):
                self._evidence[alarm_id] = str(data["pack"])
                if alarm_id in self.live.alarms:
                    self._tell_alarm(self.live.alarms[alarm_id])
            while len(self._evidence) > MOST_PACKS:
                del self._evidence[next(iter(self._evidence))]

    def _tell_alarm(self, body: Body) -> None:
        self.hub.tell("alarm", self._alarm(body))

    def _alarm(self, body: Body) -> dict[str, Any]:
        pack = self._evidence.get(body["id"])
        page = f"{self._reports}/evidence/{pack.removesuffix('.mcap')}.html" if pack and self._reports else None
        return shapes.alarm(body, self._acknowledged.get(body["id"]) if body["active"] else None, page)

    # all of it now --------------------------------------------------------------------------------

    def is_up(self, alarm_id: str) -> bool:
        """True if an alarm is active, or on the shelf."""
        return alarm_id in self.live.alarms or self.is_shelved(alarm_id)

    def is_shelved(self, alarm_id: str) -> bool:
        """True if an alarm is on the shelf."""
        return any(body["id"] == alarm_id for body in self._shelved)

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
            "alarms": [self._alarm(body) for body in live.alarms.values()],
            "shelved": self._shelved,
            "intervals": [shapes.interval(body) for body in live.intervals],
            "task": None if live.task is None else shapes.task(live.task),
            "energies": {name: [shapes.energy(e) for e in kept] for name, kept in live.energies.items()},
            "predictions": [
                {"model": model, "outputs": dict(zip(history.names, history.units, strict=True))}
                for model, history in live.predicted.items()
            ],
            "arms": self.arms,
        }
