"""CAN frames of a sensor up to samples, an adapter's lines, error frames."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import cache
from io import BytesIO
from queue import SimpleQueue
from typing import Any

from can import Message

from cellwatt_drivers.can_sensor.bus_errors import decode_error
from cellwatt_drivers.can_sensor.intake import Intake
from cellwatt_drivers.can_sensor.sensor_map import Decoding, load_decodings
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target

_HEAD = struct.Struct(">HBB")
"""Time since the frame before in ms, message, bytes of data."""
KINDS = 8
"""Numbers of messages; the last is an error frame."""


@cache
def decodings() -> list[Decoding]:
    """Those of the packaged map."""
    return list(load_decodings("ivt_s", None)[1].values())


class _Port(BytesIO):
    """As much of a serial port as the library reads."""

    @property
    def in_waiting(self) -> int:
        return len(self.getvalue()) - self.tell()


def run(data: bytes) -> None:
    """As frames with their times, and as what a serial adapter sends."""
    _frames(data)
    _lines(data)


def _frames(data: bytes) -> None:
    inlet = CheckingInlet()
    intakes = [Intake("sensor", decoding, 0.02 * (i % 3), inlet) for i, decoding in enumerate(decodings())]
    time, at = 1_700_000_000.0, 0
    while at + _HEAD.size <= len(data):
        after, kind, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        body = data[at : at + size % 9]
        at += len(body)
        time += (after - 100) / 1000
        if kind % KINDS == KINDS - 1:
            found = decode_error(after << 3, body)
            assert found.names
        else:
            intake = intakes[kind % KINDS % len(intakes)]
            if kind & 0x40:
                intake.resume()
            if kind & 0x80:
                intake.flush(inlet.now())
            intake.take(Message(arbitration_id=1, data=body, timestamp=time), inlet.now())
    for intake in intakes:
        intake.flush(inlet.now())
    assert inlet.account.residue == 0


def _lines(data: bytes) -> None:
    """Reads as the driver does: a damaged line must not end the connection."""
    from cellwatt_drivers.can_sensor.slcan import CountingSlcanBus

    bus: Any = CountingSlcanBus.__new__(CountingSlcanBus)
    bus.serialPortOrig, bus._buffer, bus._queue = _Port(data), bytearray(), SimpleQueue()
    bus.channel_info, bus._is_shutdown = "fuzzed", True
    for _ in range(len(data) + 1):
        bus._recv_internal(0)
    assert bus.malformed <= len(data)


def seeds() -> Iterable[bytes]:
    """Frames of each message in a row with a loss, a flag and an error frame; lines of an adapter."""
    body = bytes.fromhex("0005000003e8")
    for kind in range(KINDS):
        frames = [(120, kind, bytes([body[0], 16 * i % 256, *body[2:]])) for i in (0, 1, 3, 4)]
        yield b"".join(_HEAD.pack(after, kind, len(data)) + data for after, kind, data in frames)
    yield b"t5216000500000 3e8\rt52160005000003e8\r\rV1013\rT000005216000500\rz\r\a"


TARGET = Target(run, seeds, 1024)
