"""The device's side of Modbus, for emulators: one request at a time, over TCP or a serial line."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from typing import Final

from pymodbus.framer import FramerRTU

from cellwatt.emulation import Emulator, Port
from cellwatt.emulation.terminal import Writer, port_of
from cellwatt_drivers.shared.modbus import ILLEGAL_FUNCTION

_HEAD: Final = struct.Struct(">HHHBB")
"""Transaction, protocol, number of bytes that follow, unit, function."""
_BODY: Final = struct.Struct(">HH")
"""First register and number of registers of a request for them."""
_READ: Final = 8
"""Bytes of a request for registers in RTU framing: unit, function, address, count, checksum."""

Read = Callable[[int, int, int, int], list[int] | int | None]
"""From unit, function, first register and number of registers to these, or to the code of the exception with which the
device refuses them; ``None`` for an unknown unit."""


def modbus_port(emulator: Emulator, read: Read, *, rtu: bool = False) -> Port:
    """Port at an emulator's address that answers requests; ``rtu``: RTU frames as on a serial line, also over TCP.

    Requests for anything but registers are refused, and counted as ``refused`` like all refusals. In RTU framing only
    requests for registers are parsed; all other bytes are ignored.
    """
    emulator.tally.update(refused=0)

    def answer(unit: int, function: int, body: bytes) -> bytes | None:
        """Return function and body of the answer."""
        whole = len(body) == _BODY.size
        found = read(unit, function, *(_BODY.unpack(body) if whole else (0, 0)))
        if found is None:
            return None
        if whole and isinstance(found, list):
            return struct.pack(f">BB{len(found)}H", function, 2 * len(found), *found)
        emulator.tally["refused"] += 1
        return bytes([function | 0x80, found if whole and isinstance(found, int) else ILLEGAL_FUNCTION])

    async def talk_tcp(reader: asyncio.StreamReader, writer: Writer) -> None:
        while True:
            number, protocol, length, unit, function = _HEAD.unpack(await reader.readexactly(_HEAD.size))
            body = await reader.readexactly(max(length - 2, 0))
            if protocol != 0:
                return  # not Modbus
            await port.asked()
            if (reply := answer(unit, function, body)) is not None:
                await port.answer(_HEAD.pack(number, 0, 1 + len(reply), unit, reply[0]) + reply[1:], writer.write)

    async def talk_rtu(reader: asyncio.StreamReader, writer: Writer) -> None:
        while True:
            request = await reader.readexactly(_READ)
            while checksum(request[:-2]) != request[-2:]:
                request = request[1:] + await reader.readexactly(1)
            await port.asked()
            if (reply := answer(request[0], request[1], request[2:-2])) is not None:
                frame = request[:1] + reply
                await port.answer(frame + checksum(frame), writer.write)

    port = port_of(emulator, talk_rtu if rtu or emulator.on_terminal else talk_tcp)
    return port


def checksum(frame: bytes) -> bytes:
    """CRC-16/MODBUS of a frame, low byte first."""
    return FramerRTU.compute_CRC(frame).to_bytes(2, "big")
