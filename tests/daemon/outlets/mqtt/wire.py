"""What a client says to a broker, read from the wire: MQTT 5 packets and Sparkplug payloads, by their field numbers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from google.protobuf.empty_pb2 import Empty
from google.protobuf.unknown_fields import UnknownFieldSet

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


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if not byte & 0x80:
            return value, at


def _text(data: bytes, at: int) -> tuple[bytes, int]:
    (length,) = struct.unpack_from(">H", data, at)
    return data[at + 2 : at + 2 + length], at + 2 + length


def packets(stream: bytes) -> Iterator[Packet]:
    """The whole packets at the begin of what a client sent."""
    at = 0
    while at + 1 < len(stream):
        try:
            length, begin = _varint(stream, at + 1)
        except IndexError:
            return
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
        size, at = _varint(data, at)
        return Packet(kind, topic.decode(), data[at + size :], qos, bool(head & 1))
    if kind == SUBSCRIBE:
        size, at = _varint(data, 2)
        at += size
        filters = []
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
    size, at = _varint(data, at + 4)
    expiry = 0
    properties = data[at : at + size]
    if properties[:1] == b"\x11":
        (expiry,) = struct.unpack_from(">I", properties, 1)
    _, at = _text(data, at + size)
    topic = body = b""
    if flags & 4:
        size, at = _varint(data, at)
        topic, at = _text(data, at + size)
        body, at = _text(data, at)
    return Packet(
        CONNECT,
        topic.decode(),
        body,
        flags >> 3 & 3,
        bool(flags & 0x20),
        clean=bool(flags & 2),
        expiry=expiry,
        will=bool(flags & 4),
    )


# Sparkplug ----------------------------------------------------------------------------------------

_METRIC = {1: "name", 2: "alias", 3: "timestamp", 4: "datatype", 5: "is_historical", 7: "is_null", 9: "properties"}
_VALUE = {10: "int", 11: "long", 12: "float", 13: "double", 14: "boolean", 15: "string"}


def fields(data: bytes) -> Iterator[tuple[int, int, Any]]:
    """Number, wire type and value of each field of a protobuf message of which no fields are known."""
    for field in UnknownFieldSet(Empty.FromString(data)):
        value = field.data
        if field.wire_type == 1:
            (value,) = struct.unpack("<d", value.to_bytes(8, "little"))
        yield field.field_number, field.wire_type, value


def payload(data: bytes) -> dict[str, Any]:
    found: dict[str, Any] = {"metrics": []}
    for number, wire, value in fields(data):
        if number == 2:
            found["metrics"].append(_metric(value))
        else:
            assert wire == 0 and number in (1, 3)
            found[{1: "timestamp", 3: "seq"}[number]] = value
    return found


def _metric(data: bytes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for number, _, value in fields(data):
        if number in _VALUE:
            assert "value" not in found
            found["field"] = _VALUE[number]
            found["value"] = {"string": lambda v: v.decode(), "boolean": bool}.get(_VALUE[number], lambda v: v)(value)
        elif number == 9:
            found["properties"] = _properties(value)
        else:
            found[_METRIC[number]] = value.decode() if number == 1 else value
    if found.get("datatype") == 4 and found.get("value", 0) >= MAY_BE_SIGNED:
        found["value"] -= 1 << 64
    return found


def _properties(data: bytes) -> dict[str, Any]:
    keys, values = [], []
    for number, _, value in fields(data):
        if number == 1:
            keys.append(value.decode())
        else:
            told = {n: v for n, _, v in fields(value)}
            values.append((told[1], told[8].decode()))
    assert len(keys) == len(values)
    return dict(zip(keys, values, strict=True))


def command(name: str, value: bool) -> bytes:
    """An NCMD payload with one metric, encoded by hand."""
    raw = name.encode()
    metric = b"\x0a" + bytes([len(raw)]) + raw + b"\x20\x0b" + b"\x70" + bytes([value])
    return b"\x08\x01\x12" + bytes([len(metric)]) + metric


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
