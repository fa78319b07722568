"""The board's payload: one sample, or several with one header, under a CRC. See docs/drivers/power_board.md.

All fields are little-endian. Version 1 carries one sample, version 2 several at an even step:

    1: version u8 · board u8 · sequence u16 · time u32 µs · phases × (U, I, P) · crc u16
    2: version u8 · board u8 · sequence u16 · time u32 µs · samples u8 · phases u8 · step u16 µs
       · samples × phases × (U, I, P) · crc u16

with U u16 in 10 mV, I u16 in 1 mA, P i32 in 10 mW, and CRC-16/CCITT-FALSE over everything before it.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cellwatt import Quality

MAX_PHASES = 3
SHORTEST = 18
LONGEST = 255
TIME_WRAP = 1 << 32
SEQUENCE_WRAP = 1 << 16

_HEADER = struct.Struct("<BBHI")
_BATCH = struct.Struct("<BBH")
_CRC = struct.Struct("<H")
_MEASURED = "HHi"
_PER_SI = np.array([100.0, 1000.0, 100.0])
_TOP = np.array([0xFFFF, 0xFFFF, 0x7FFF_FFFF])


class Packet(NamedTuple):
    """Content of one radio packet.

    ``sequence`` (u16) and ``time`` (u32 µs of the board's clock) are those of the first sample; ``step`` is µs from
    sample to sample, 0 for one sample. ``raw`` holds, sample by sample and phase by phase, U, I, P in device units, for
    ``measured``.
    """

    board: int
    sequence: int
    time: int
    step: int
    phases: int
    raw: tuple[int, ...]

    @property
    def samples(self) -> int:
        """Number of samples in the packet."""
        return len(self.raw) // (3 * self.phases)


@cache
def _fields(n: int) -> struct.Struct:
    return struct.Struct("<" + _MEASURED * n)


def parse(data: bytes) -> Packet | None:
    """The packet in ``data``, or ``None`` if CRC, version or length do not match a board's payload."""
    if len(data) < SHORTEST or crc_hqx(data[:-2], 0xFFFF) != data[-2] | data[-1] << 8:
        return None
    version, board, sequence, time = _HEADER.unpack_from(data)
    start, samples, phases, step = _HEADER.size, 1, (len(data) - SHORTEST) // 8 + 1, 0
    if version == 2:
        start, (samples, phases, step) = start + _BATCH.size, _BATCH.unpack_from(data, start)
    count = samples * phases
    known = version == 1 or (version == 2 and samples and step)
    if not known or not 1 <= phases <= MAX_PHASES or len(data) != start + 8 * count + _CRC.size:
        return None
    return Packet(board, sequence, time, step, phases, _fields(count).unpack_from(data, start))


def build(packet: Packet) -> bytes:
    """The payload of a packet: version 1 for one sample without a step, else version 2.

    Raises ``ValueError`` if a field is out of range or the payload would exceed 255 bytes.
    """
    count = len(packet.raw) // 3
    version = 2 if packet.step else 1
    if not 1 <= packet.phases <= MAX_PHASES or not packet.samples or (version == 1 and packet.samples > 1):
        raise ValueError(
            f"{packet.samples} samples of {packet.phases} phases at a step of {packet.step} µs: no such form"
        )
    try:
        body = _HEADER.pack(version, packet.board, packet.sequence, packet.time)
        if version == 2:
            body += _BATCH.pack(packet.samples, packet.phases, packet.step)
        body += _fields(count).pack(*packet.raw)
    except struct.error as error:
        raise ValueError(f"a field of the payload is out of range: {error}") from error
    if len(body) + _CRC.size > LONGEST:
        raise ValueError(f"{packet.samples} samples of {packet.phases} phases do not fit {LONGEST} bytes")
    return body + _CRC.pack(crc_hqx(body, 0xFFFF))


def raw(measured: NDArray[np.float64]) -> tuple[int, ...]:
    """Convert ``measured`` (samples, phases, 3) in V, A, W to device units; values out of range saturate."""
    rounded = np.rint(measured * _PER_SI)
    limited = np.clip(rounded, np.array([0, 0, -0x8000_0000]), _TOP)
    return tuple(int(x) for x in limited.ravel())


def measured(raw: Sequence[int], phases: int) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """SI values (samples, phases, 3) in V, A, W of ``Packet.raw``, and each sample's quality (samples,).

    A field at the end of its range (655.35 V, 65.535 A, ±21.47 MW) marks its sample as clipped.
    """
    table = np.asarray(raw, dtype=np.float64).reshape(-1, phases, 3)
    clipped = ((table >= _TOP) | (table <= -0x8000_0000)).any(axis=(1, 2))
    return table / _PER_SI, np.where(clipped, Quality.CLIPPED, Quality.GOOD).astype(np.uint8)
