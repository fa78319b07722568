"""The cell as JSON on plain topics, ``cellwatt/SITE/CELL/…``. Pure."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from cellwatt.alarms import AlarmBook
from cellwatt.outlets.mqtt.message import Message, Order, Subscription, level
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row
from cellwatt.outlets.zenoh.keys import PREFIX
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item, encode_json, topic_of
from cellwatt.results import Alarm, Event, Interval, Result

ONLINE, OFFLINE = b"online", b"offline"
_RETAINED: Final = ("interval", "task", "energy")
"""Results whose latest message the broker retains."""


class PlainFormat:
    """Messages of a cell as JSON; ``alarms`` is its alarm book."""

    announced = False
    """The broker does not publish the will after an intended disconnect."""

    def __init__(self, settings: MqttSettings, site: str, cell: str, alarms: AlarmBook) -> None:
        self._settings = settings
        self.root = f"{PREFIX}/{level(site)}/{level(cell)}"
        self._session = time.time_ns()
        self._numbers: Counter[str] = Counter()
        self._units: Mapping[str, str] = {}
        """Units of the rows' channels."""
        self._alarms = alarms
        self._retained: dict[str, str] = {}
        """Topics of alarms that the broker may retain, by alarm id."""
        self._subscribes = True
        """False while a connection that broke before the birth was the last: some brokers cut forbidden subscribers."""
        self._open: dict[str, int] = {}
        """Number of the running interval published for each source."""

    @property
    def ready(self) -> bool:
        """Always true: plain topics have no primary host."""
        return True

    def connect(self) -> Message:
        """Begin a new connection; return its will message."""
        return self._message("availability", OFFLINE, 1, True)

    def subscriptions(self) -> Sequence[Subscription]:
        """The cell's own alarms and row, to delete those that the broker retains from an earlier daemon."""
        topics, self._subscribes = ("alarm/#", "frame") if self._subscribes else (), False
        return [Subscription(f"{self.root}/{topic}", 0, needed=False) for topic in topics]

    def heard(self, topic: str, payload: bytes, retained: bool) -> Order | Sequence[Message]:
        """Delete a retained alarm that is not active, and a retained row if rows are not to be retained."""
        if not (retained and payload) or (topic == f"{self.root}/frame" and self._settings.retain):
            return ()
        up = (f"{self.root}/{_alarm_topic(standing.alarm)}" for standing in self._alarms.up)
        if topic in (*self._retained.values(), *up):
            return ()
        return (Message(topic, b"", self._settings.qos, True),)

    def birth(self, now: int) -> Sequence[Message]:
        """Availability online, units and active alarms; cleared alarms are deleted."""
        self._subscribes = True
        over = [self._deleted(id_) for id_ in list(self._retained) if id_ not in self._alarms]
        up = [m for standing in self._alarms.raised if standing.published for m in self._alarm(standing.published)]
        return (self._message("availability", ONLINE, 1, True), *over, *up, *self._labelled())

    def label(self, units: Mapping[str, str], now: int) -> Sequence[Message]:
        """The units of the rows' channels, retained."""
        self._units = units
        return self._labelled()

    def _labelled(self) -> Sequence[Message]:
        return (self._message("units", encode_json(self._units), 1, True),) if self._units else ()

    def missed(self, row: Row) -> None:
        """Nothing to update for a row that is not sent, or sent later."""

    def row(self, row: Row, historical: bool, now: int) -> Sequence[Message]:
        """A row as one message; historical rows on ``backfill/frame``."""
        less = {name: quality for name, quality in row.quality.items() if quality}
        body: dict[str, Any] = {"time": row.time, "sequence": row.sequence, "values": row.values, "quality": less}
        topic, keep = "frame", self._settings.retain
        if historical:
            topic, keep, body["backfilled"] = "backfill/frame", False, True
        return (self._message(topic, encode_json(body), self._settings.qos, keep),)

    def predicted(self, model: str, units: Mapping[str, str], row: Row, now: int) -> Sequence[Message]:
        """A row of a model's outputs on ``prediction/MODEL``."""
        body = {"time": row.time, "sequence": row.sequence, "values": row.values, "units": units}
        return (self._message(f"prediction/{level(model)}", encode_json(body), self._settings.qos, False),)

    def result(self, item: Result | Event, historical: bool, now: int) -> Sequence[Message]:
        """A result, encoded as over Zenoh; an interval is published when it begins and when it ends."""
        if isinstance(item, Alarm):
            return self._alarm(item)
        if isinstance(item, Interval) and not item.closed:
            if self._open.get(item.source) == item.number:
                return ()
            self._open[item.source] = item.number
        topic = topic_of(item)
        return (self._message(topic, self._encoded(topic, item), self._settings.qos, topic in _RETAINED),)

    def _alarm(self, alarm: Alarm) -> Sequence[Message]:
        """An active alarm is retained on its topic; a clear is published there once, and then nothing is retained."""
        message = self._message(_alarm_topic(alarm), self._encoded("alarm", alarm), self._settings.qos, alarm.active)
        moved = [] if self._retained.get(alarm.id) in (None, message.topic) else [self._deleted(alarm.id)]
        self._retained[alarm.id] = message.topic
        return (*moved, message) if alarm.active else (*moved, message, self._deleted(alarm.id))

    def _deleted(self, id_: str) -> Message:
        return Message(self._retained.pop(id_), b"", self._settings.qos, True)

    def archived(self, result: Archived, now: int) -> Sequence[Message]:
        """A back-filled result below ``backfill``, not retained."""
        topic = f"backfill/{topic_of(result)}"
        return (self._message(topic, self._encoded(topic, result), self._settings.qos, False),)

    def health(self, status: Mapping[str, Any], now: int) -> Sequence[Message]:
        """The cell's health, retained."""
        return (self._message("health", encode_json(status), 0, True),)

    def death(self, now: int) -> Sequence[Message]:
        """Availability offline."""
        return (self._message("availability", OFFLINE, 1, True),)

    def _encoded(self, topic: str, item: Result | Event) -> bytes:
        number = self._numbers[topic]
        self._numbers[topic] += 1
        return encode_item(item, Mark(self._session, number, 1, 0))

    def _message(self, topic: str, payload: bytes, qos: int, retain: bool) -> Message:
        return Message(f"{self.root}/{topic}", payload, qos, retain)


def _alarm_topic(alarm: Alarm) -> str:
    return f"alarm/{level(alarm.severity)}/{level(alarm.kind)}/{level(alarm.id)}"
