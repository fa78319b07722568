"""The cell as a Sparkplug B edge node with one device per source: births, deaths, data, sequence numbers. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from cellwatt.alarms import AlarmBook
from cellwatt.errors import ProtocolError
from cellwatt.outlets.mqtt.message import Message, Order, Subscription, level
from cellwatt.outlets.mqtt.payload import (
    MS,
    DataType,
    Device,
    Metric,
    Tag,
    Tags,
    Values,
    decode,
    encode,
    finite,
    metric,
    values_of,
)
from cellwatt.outlets.mqtt.settings import SparkplugSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row
from cellwatt.outlets.zenoh.messages import parse_json
from cellwatt.results import Alarm, Event, Result

NAMESPACE: Final = "spBv1.0"
REBIRTH: Final = "Node Control/Rebirth"
NUMBERS: Final = 256
"""Modulus of the sequence numbers of messages (seq) and connections (bdSeq)."""


class EdgeNode:
    """Messages of an edge node. ``births`` is the bdSeq of the next connection; ``alarms`` is the cell's alarm book."""

    announced = True
    """The broker publishes the death certificate also after an intended disconnect."""

    def __init__(self, settings: SparkplugSettings, site: str, cell: str, alarms: AlarmBook, births: int = 0) -> None:
        self._group = level(settings.group or site)
        self._node = level(settings.node or cell)
        self._host = settings.primary_host
        self._online = self._host is None
        self._host_state_at: int | None = None
        """Timestamp of the last accepted state message of the primary host."""
        self.births = births
        self._birth = 0
        self._seq = 0
        self._tags = Tags()
        self._units: Mapping[str, str] = {}
        self._sources: frozenset[str] = frozenset()
        """Sources of the rows' channels, once they are known."""
        self._filled = set[str]()
        """Sources with historical rows since the last live row."""
        self._alarms = alarms
        self._tags.declare(self._tags.node, "health/state", DataType.STRING)
        self._active = self._tags.declare(self._tags.node, "alarms/active", DataType.INT64)

    @property
    def ready(self) -> bool:
        """True while there is no primary host, or it is online."""
        return self._online

    # sessions -------------------------------------------------------------------------------------

    def connect(self) -> Message:
        """Begin a new connection; return its will message, the death certificate."""
        self._birth, self.births = self.births, (self.births + 1) % NUMBERS
        self._online = self._host is None
        for device in (self._tags.node, *self._tags.devices.values()):
            device.born = False
        return self._death(0)

    def subscriptions(self) -> Sequence[Subscription]:
        """Subscriptions to commands for this node and to the state of the primary host."""
        commands = Subscription(f"{NAMESPACE}/{self._group}/NCMD/{self._node}", 1)
        return (commands,) if self._host is None else (commands, Subscription(self._state_topic, 1))

    @property
    def _state_topic(self) -> str:
        return f"{NAMESPACE}/STATE/{self._host}"

    def heard(self, topic: str, payload: bytes, retained: bool) -> Order | Sequence[Message]:
        """Process a command or the host's state. Raises ``ProtocolError`` if it cannot be decoded."""
        if self._host is not None and topic == self._state_topic:
            return self._host_state(payload)
        if topic == f"{NAMESPACE}/{self._group}/NCMD/{self._node}":
            wanted = any(name == REBIRTH and value is True for name, value in decode(payload))
            return Order.BIRTH if wanted and self._tags.node.born else ()
        return ()

    def _host_state(self, payload: bytes) -> Order | Sequence[Message]:
        """Follow the state of the primary host; ignore messages older than the last one."""
        try:
            state = parse_json(payload)
            online, timestamp = state["online"], state["timestamp"]
        except (ValueError, TypeError, KeyError):
            online = timestamp = None
        if not isinstance(online, bool) or not isinstance(timestamp, int):
            raise ProtocolError("the state of the primary host is not a valid Sparkplug message")
        if self._host_state_at is not None and timestamp < self._host_state_at:
            return ()
        self._host_state_at = timestamp
        before, self._online = self._online, online
        if online == before:
            return ()
        return Order.BIRTH if online else Order.LEAVE

    def birth(self, now: int) -> Sequence[Message]:
        """Birth certificates of the node and of all devices that have data."""
        self._seq = 0
        node, at = self._tags.node, now // MS
        self._active.value = len(self._alarms.up)
        metrics = [
            metric(DataType.INT64, self._birth, at, "bdSeq", declared=True),
            metric(DataType.BOOLEAN, False, at, REBIRTH, declared=True),
            *(tag.born(at) for tag in node.tags.values()),
        ]
        node.born, node.grown = True, False
        messages = [self._message("NBIRTH", None, metrics, at)]
        for name, device in self._tags.devices.items():
            device.born = False
            if device.present:
                messages.append(self._device_birth(name, device, at))
        return messages

    def death(self, now: int) -> Sequence[Message]:
        """The death certificate of the node, if its birth was sent."""
        return (self._death(now // MS),) if self._tags.node.born else ()

    def _death(self, at: int) -> Message:
        """The death certificate that belongs to the birth of this connection; it has no sequence number."""
        payload = encode([metric(DataType.INT64, self._birth, at, "bdSeq", declared=True)], at, None)
        return Message(f"{NAMESPACE}/{self._group}/NDEATH/{self._node}", payload, 1, False)

    # data -----------------------------------------------------------------------------------------

    def label(self, units: Mapping[str, str], now: int) -> Sequence[Message]:
        """Declare the channels of the rows; deaths of devices that are not among them any more.

        The birth of a device is sent with its first values.
        """
        self._units, self._sources = units, frozenset(name.partition(".")[0] for name in units)
        for name, unit in units.items():
            self._tags.channel(name, unit)
        for source, device in self._tags.devices.items():
            for tag in device.tags.values() if self._is_removed(source) else ():
                tag.value = None
        self._filled.clear()
        return self._deaths(now // MS)

    def _is_removed(self, source: str) -> bool:
        """True for a source that a reload removed: no channel of the rows is its own."""
        return bool(self._sources) and source not in self._sources

    def _deaths(self, at: int) -> list[Message]:
        """Deaths of the devices of removed sources without historical rows since the last live row."""
        gone = (source for source in self._tags.devices if self._is_removed(source) and source not in self._filled)
        devices = ((source, self._tags.devices[source]) for source in gone)
        return [self._device_death(source, device, at) for source, device in devices if device.born]

    def missed(self, row: Row) -> None:
        """Update the current values from a row without publishing it."""
        for name in row.quality:
            source, tag = self._channel(name)
            if not self._is_removed(source):
                self._set(tag, row, name)

    def row(self, row: Row, historical: bool, now: int) -> Sequence[Message]:
        """Messages with the values that a row changes, per device; with all values if the row is historical.

        Values of removed sources are always historical; their death follows when no more of them come.
        """
        messages: list[Message] = []
        by_device: dict[str, list[tuple[str, Tag]]] = {}
        for name in row.quality:
            source, tag = self._channel(name)
            by_device.setdefault(source, []).append((name, tag))
        for source, members in by_device.items():
            messages += self._device_row(source, members, row, historical or self._is_removed(source), now // MS)
        if historical:
            self._filled |= by_device.keys()
        else:
            messages += self._deaths(now // MS)
            self._filled.clear()
        return messages

    def _device_row(
        self, source: str, members: Sequence[tuple[str, Tag]], row: Row, historical: bool, at: int
    ) -> Sequence[Message]:
        device, time = self._tags.devices[source], row.time // MS
        found: list[Message] = []
        if historical:
            if not device.born or device.grown:
                found.append(self._device_birth(source, device, at))
            metrics = [tag.data(finite(row.values.get(name)), time, True) for name, tag in members]
            return [*found, self._message("DDATA", source, metrics, at)]
        changed = [tag for name, tag in members if self._set(tag, row, name)]
        if not device.present:
            return [self._device_death(source, device, at)] if device.born else []
        if not device.born or device.grown:
            return [self._device_birth(source, device, at)]
        metrics = [tag.data(tag.value, time, False) for tag in changed]
        return [self._message("DDATA", source, metrics, at)] if metrics else []

    def _channel(self, name: str) -> tuple[str, Tag]:
        return self._tags.channel(name, self._units.get(name))

    def _set(self, tag: Tag, row: Row, name: str) -> bool:
        """Update a channel's value from a row; true if it changed."""
        value = finite(row.values.get(name))
        changed = value != tag.value
        tag.value, tag.time = value, row.time // MS
        return changed

    def predicted(self, model: str, units: Mapping[str, str], row: Row, now: int) -> Sequence[Message]:
        """A row of a model's outputs as metrics of the node."""
        values: Values = {
            f"prediction/{model}/{name}": (DataType.DOUBLE, finite(row.values.get(name)), units[name])
            for name in row.quality
        }
        return self._node_data(values, row.time // MS, False, now // MS)

    def result(self, item: Result | Event, historical: bool, now: int) -> Sequence[Message]:
        """A result as metrics of the node; events and running intervals have no metrics."""
        time, values = values_of(item)
        messages = list(self._node_data(values, time, historical, now // MS)) if values else []
        if isinstance(item, Alarm):
            count: Values = {"alarms/active": (DataType.INT64, len(self._alarms.up), None)}
            messages += self._node_data(count, time, False, now // MS)
        return messages

    def archived(self, result: Archived, now: int) -> Sequence[Message]:
        """A back-filled result as historical metrics."""
        time, values = values_of(result)
        return self._node_data(values, time, True, now // MS)

    def health(self, status: Mapping[str, Any], now: int) -> Sequence[Message]:
        """The state of the cell as a metric, if it changed."""
        state, node = str(status.get("state", "")), self._tags.node
        if node.tags["health/state"].value == state:
            return ()
        return self._node_data({"health/state": (DataType.STRING, state, None)}, now // MS, False, now // MS)

    def _node_data(self, values: Values, time: int, historical: bool, at: int) -> Sequence[Message]:
        node, metrics = self._tags.node, []
        for name, (datatype, value, unit) in values.items():
            tag = self._tags.declare(node, name, datatype, unit)
            if not historical:
                tag.value, tag.time = value, time
            metrics.append(tag.data(value, time, historical))
        if not node.born:
            return ()
        births = self.birth(at * MS) if node.grown else ()
        if births and not historical:
            return births
        return [*births, self._message("NDATA", None, metrics, at)]

    # messages -------------------------------------------------------------------------------------

    def _device_birth(self, name: str, device: Device, at: int) -> Message:
        device.born, device.grown = True, False
        return self._message("DBIRTH", name, [tag.born(at) for tag in device.tags.values()], at)

    def _device_death(self, name: str, device: Device, at: int) -> Message:
        device.born = False
        return self._message("DDEATH", name, [], at)

    def _message(self, kind: str, device: str | None, metrics: Sequence[Metric], at: int) -> Message:
        topic = f"{NAMESPACE}/{self._group}/{kind}/{self._node}"
        number, self._seq = self._seq, (self._seq + 1) % NUMBERS
        return Message(topic if device is None else f"{topic}/{level(device)}", encode(metrics, at, number))
