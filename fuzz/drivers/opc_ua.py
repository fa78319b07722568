"""What an OPC UA server tells the driver, and what a client hands to the method that acknowledges."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from functools import cache
from types import SimpleNamespace
from typing import Any, Final

from asyncua import ua
from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.ua.ua_binary import struct_from_binary, struct_to_binary, variant_from_binary, variant_to_binary

from cellwatt.channel import Channel, Stream
from cellwatt.outlets.opc_ua.arrays import bound_arrays
from cellwatt.outlets.opc_ua.conditions import USER, Conditions
from cellwatt_drivers.opc_ua import messages
from cellwatt_drivers.opc_ua.intake import Intake
from cellwatt_drivers.opc_ua.nodes import TagPlace
from fuzz.drivers.inlet import CheckingInlet
from fuzz.items import SESSION
from fuzz.target import Target

STREAM: Final = Stream("tags", (Channel("speed", "rad/s"), Channel("torque", "Nm")), 10.0, "device")
SOURCES: Final = {
    0: [TagPlace(0, ua.NodeId(1), (), 1.0, 0.0)],
    1: [TagPlace(1, ua.NodeId(2), (1,), 0.001, 273.15)],
}
EVENT: Final = b"event"
NOTICE: Final = b"N"
UNREADABLE: Final = (
    NotEnoughData, ua.UaError, struct.error, ValueError, TypeError, KeyError, IndexError, AttributeError,
    OverflowError, RecursionError, MemoryError, EOFError,
)  # fmt: skip
"""Errors of asyncua's own decoding, which come before any reader of ours."""


@cache
def _asked() -> tuple[Conditions, list[Mapping[str, Any]]]:
    server: Any = SimpleNamespace()
    parent: Any = SimpleNamespace()
    told: list[Mapping[str, Any]] = []

    async def order(what: Mapping[str, Any]) -> None:
        told.append(what)

    conditions = Conditions(server, 4, parent, order)
    conditions._known["a1"] = _condition()
    return conditions, told


def _condition() -> Any:
    return SimpleNamespace(events=[EVENT], acknowledged=False)


def run(data: bytes) -> None:
    """``N`` and messages of a server, each with a length; or the arguments of a call: id of an event, note."""
    if data.startswith(NOTICE):
        _told(data[1:])
    else:
        _called(data)


bound_arrays()


def _told(data: bytes) -> None:
    intake = Intake("cell", CheckingInlet(), STREAM)
    arrival = SESSION
    at = 0
    while at + 2 <= len(data):
        (length,) = struct.unpack_from("<H", data, at)
        body, at = data[at + 2 : at + 2 + length], at + 2 + length
        arrival += 100_000_000
        try:
            items = [struct_from_binary(ua.MonitoredItemNotification, Buffer(part)) for part in body.split(b"\xfe\xfe")]
        except UNREADABLE:
            continue
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=arrival // 1000)
        notice = SimpleNamespace(SequenceNumber=at, PublishTime=moment, NotificationData=_parts(items))
        result: Any = SimpleNamespace(NotificationMessage=notice)
        for server_time in (True, False):
            found = messages.read(result, SOURCES, server_time)
        intake.take(found, arrival)


def _parts(items: list[Any]) -> list[Any]:
    return [SimpleNamespace(MonitoredItems=items)]


def _called(data: bytes) -> None:
    conditions, told = _asked()
    buffer = Buffer(data)
    try:
        event, note = variant_from_binary(buffer), variant_from_binary(buffer)
    except UNREADABLE:
        return
    told.clear()
    answer = asyncio.run(_by_eve(conditions, event, note))
    assert answer.is_good() == bool(told)
    assert all(isinstance(what["note"], str) and len(what["note"]) <= 1000 for what in told)


async def _by_eve(conditions: Conditions, event: ua.Variant, note: ua.Variant) -> ua.StatusCode:
    USER.set("eve")
    return await conditions._acknowledge(ua.NodeId("alarm:a1", 4), event, note)


def _notice(handle: int, value: Any, at: int, code: int = 0) -> bytes:
    moment = datetime.fromtimestamp(at / 1e9, UTC)
    value = ua.DataValue(ua.Variant(value), ua.StatusCode(code), SourceTimestamp=moment, ServerTimestamp=moment)
    body: bytes = struct_to_binary(ua.MonitoredItemNotification(handle, value))
    return body


def _message(*parts: bytes) -> bytes:
    body = b"\xfe\xfe".join(parts)
    return struct.pack("<H", len(body)) + body


def seeds() -> Iterable[bytes]:
    """Values, arrays, bad ones, times that are none; a note, an id that is a number."""
    late = 4_102_444_800 * 10**9
    first = _message(_notice(0, 1.5, SESSION), _notice(1, [1.0, 2.0], SESSION))
    yield NOTICE + first + _message(_notice(0, 1.75, SESSION + 10**8)) + _message(_notice(0, 2.0, SESSION + 5 * 10**8))
    yield NOTICE + first + _message(_notice(1, "words", SESSION + 10**8)) + _message(_notice(0, 1, SESSION, 0x80000000))
    yield NOTICE + first + _message(_notice(0, 1.0, late)) + _message(_notice(0, 2.0, late))
    yield NOTICE + _message(_notice(0, True, 0, 0x480), _notice(1, [1], 10**9))
    end = ua.DataValue(ua.Variant(1.0), SourceTimestamp=datetime(9999, 1, 1, tzinfo=UTC))
    yield NOTICE + first + _message(struct_to_binary(ua.MonitoredItemNotification(0, end)))
    note = variant_to_binary(ua.Variant(ua.LocalizedText("on my way")))
    yield variant_to_binary(ua.Variant(EVENT, ua.VariantType.ByteString)) + note
    yield variant_to_binary(ua.Variant(2**31, ua.VariantType.UInt32)) + note
    yield b"\x80\xff\xff\xff\x7f" + note
    yield variant_to_binary(ua.Variant("event", ua.VariantType.String)) + variant_to_binary(ua.Variant(7))


TARGET = Target(run, seeds, 1024)
