"""What a client says to a broker, read from the wire: MQTT 5 packets and Sparkplug payloads, by their field numbers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from google.protobuf.unknown_fields import UnknownFieldSet
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties, VariableByteIntegers

from cellwatt.protobuf import Messages
from tests.daemon.outlets.zenoh.processes import Link

CONNECT, PUBLISH, SUBSCRIBE, DISCONNECT = 1, 3, 8, 14
MAY_BE_SIGNED = 1 << 63


@dataclass(frozen=True)
class Packet:
    """A packet from the client; ``body`` is a decoded Sparkplug payload of what is published, or of the will."""

    kind: int
    topic: str = ""
    payload: bytes = b""
    qos: int = 0
    retain: bool = False
    clean: bool = False
    expiry: int = 0
    filters: tuple[tuple[str, int], ...] = ()
    reason: int = 0
    will: bool = False

    @property
    def verb(self) -> str:
        """The Sparkplug message type of the topic."""
        parts = self.topic.split("/")
        return parts[2] if len(parts) > 3 and parts[0] == "spBv1.0" else ""

    @property
    def body(self) -> dict[str, Any]:
        return payload(self.payload)


def _text(data: bytes, at: int) -> tuple[bytes, int]:
    (length,) = struct.unpack_from(">H", data, at)
    return data[at + 2 : at + 2 + length], at + 2 + length


def packets(stream: bytes) -> Iterator[Packet]:
    """The whole packets at the begin of what a client sent."""
    at = 0
    while at + 1 < len(stream):
        length, size = VariableByteIntegers.decode(stream[at + 1 : at + 5] + b"\0")
        begin = at + 1 + size
        if begin + length > len(stream):
            return
        found = _packet(stream[at], stream[begin : begin + length])
        if found is not None:
            yield found
        at = begin + length


def _packet(head: int, data: bytes) -> Packet | None:
    kind = head >> 4
    if kind == CONNECT:
        return _connect(data)
    if kind == PUBLISH:
        topic, at = _text(data, 0)
        qos = head >> 1 & 3
        at += 2 if qos else 0
        _, size = Properties(kind).unpack(data[at:])
        return Packet(kind, topic.decode(), data[at + size :], qos, bool(head & 1))
    if kind == SUBSCRIBE:
        _, size = Properties(kind).unpack(data[2:])
        at, filters = 2 + size, []
        while at < len(data):
            name, at = _text(data, at)
            filters.append((name.decode(), data[at] & 3))
            at += 1
        return Packet(kind, filters=tuple(filters))
    return Packet(kind, reason=data[0] if data else 0) if kind == DISCONNECT else None


def _connect(data: bytes) -> Packet:
    name, at = _text(data, 0)
    assert (name, data[at]) == (b"MQTT", 5)
    flags = data[at + 1]
    properties, size = Properties(CONNECT).unpack(data[at + 4 :])
    _, at = _text(data, at + 4 + size)
    topic = body = b""
    if flags & 4:
        _, size = Properties(PacketTypes.WILLMESSAGE).unpack(data[at:])
        topic, at = _text(data, at + size)
        body, at = _text(data, at)
    return Packet(
        CONNECT,
        topic.decode(),
        body,
        flags >> 3 & 3,
        bool(flags & 0x20),
        clean=bool(flags & 2),
        expiry=getattr(properties, "SessionExpiryInterval", 0),
        will=bool(flags & 4),
    )


# Sparkplug ----------------------------------------------------------------------------------------

_SPARKPLUG = Messages(
    "tests.sparkplug",
    {
        "PropertyValue": {"type": (1, "uint32"), "string": (8, "string")},
        "PropertySet": {"keys": (1, "string*"), "values": (2, "PropertyValue*")},
        "Metric": {
            "name": (1, "string"),
            "alias": (2, "uint64"),
            "timestamp": (3, "uint64"),
            "datatype": (4, "uint32"),
            "is_historical": (5, "bool"),
            "is_null": (7, "bool"),
            "properties": (9, "PropertySet"),
            "long": (11, "uint64."),
            "double": (13, "double."),
            "boolean": (14, "bool."),
            "string": (15, "string."),
        },
        "Payload": {"timestamp": (1, "uint64"), "metrics": (2, "Metric*"), "seq": (3, "uint64")},
    },
)


def payload(data: bytes) -> dict[str, Any]:
    told = _SPARKPLUG.parse("Payload", data, "a payload")
    return {**_fields(told), "metrics": [_metric(each) for each in told.metrics]}


def _fields(message: Any) -> dict[str, Any]:
    assert not len(UnknownFieldSet(message))
    return {field.name: value for field, value in message.ListFields()}


def _metric(message: Any) -> dict[str, Any]:
    found = _fields(message)
    if (kind := message.WhichOneof("value")) is not None:
        found |= {"field": kind, "value": found[kind]}
    if found.get("datatype") == 4 and found.get("value", 0) >= MAY_BE_SIGNED:
        found["value"] -= 1 << 64
    if "properties" in found:
        told = message.properties
        found["properties"] = {key: (v.type, v.string) for key, v in zip(told.keys, told.values, strict=True)}
    return found


def command(name: str, value: bool) -> bytes:
    """An NCMD payload with one metric."""
    metric = _SPARKPLUG.classes["Metric"](name=name, datatype=11, boolean=value)
    told: bytes = _SPARKPLUG.classes["Payload"](timestamp=1, metrics=[metric]).SerializeToString()
    return told


# the wire -----------------------------------------------------------------------------------------


class Tap(Link):
    """A line to a broker that can be cut; hears what the client says, all connections in order."""

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    @property
    def connections(self) -> list[list[Packet]]:
        return [list(packets(bytes(stream))) for stream in self.streams]

    def said(self) -> list[Packet]:
        return [packet for connection in self.connections for packet in connection]

    def verbs(self) -> list[str]:
        return [p.verb for p in self.said() if p.kind == PUBLISH]
