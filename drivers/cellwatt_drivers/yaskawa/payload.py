"""Data of each answer ⇄ values; all integers are signed 32 bit unless stated otherwise."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cellwatt.errors import ProtocolError

PULSE = 0
BASE = 16
"""Data types of a position: encoder pulses, or Cartesian in the base frame."""

METRES = 1e-6
"""m per count of X, Y, Z."""
DEGREES = 1e-4
"""Degrees per count of Rx, Ry, Rz."""

_KIND = struct.Struct("<i")
_POSITION_HEAD = 20  # kind, figure, tool, user frame, extended figure
_AXES = {4 * n: struct.Struct(f"<{n}i") for n in range(1, 10)}
_STATUS = struct.Struct("<Q")
_ALARM = struct.Struct("<3I16s32s")
_SYSTEM = struct.Struct("<24s16s8s")
_NAME_SIZE = 4
_AXIS_SLOTS = 8


_MODE, _STATE = 1, 1 << 32
STATUS_BITS: Final[Mapping[str, int]] = {
    "running": 8 * _MODE, "servo_on": 64 * _STATE, "hold": 14 * _STATE, "alarm": 16 * _STATE, "error": 32 * _STATE,
    "remote": 128 * _MODE, "play": 64 * _MODE, "teach": 32 * _MODE, "automatic": 4 * _MODE, "one_cycle": 2 * _MODE,
    "step": 1 * _MODE, "speed_limited": 16 * _MODE,
}  # fmt: skip
"""Bits of the status, whose two words form one number here; other bits are ignored. ``hold``: by pendant, externally
or by command."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """Answer to 0x70; all zero without an alarm. ``time`` is the controller's time as text."""

    code: int
    data: int = 0
    kind: int = 0
    time: str = ""
    name: str = ""


@dataclass(frozen=True, slots=True)
class System:
    """Answer to 0x89: system information."""

    software: str
    model: str
    parameters: str


def decode_status(data: bytes) -> dict[str, bool]:
    """Decode the bits of ``STATUS_BITS``. Raises ``ProtocolError`` unless there are two words."""
    (word,) = _STATUS.unpack(_sized(data, _STATUS, "status"))
    return {name: bool(word & bits) for name, bits in STATUS_BITS.items()}


def encode_status(*names: str) -> bytes:
    """Encode a status with these bits set, 8 bytes."""
    return _STATUS.pack(sum(STATUS_BITS[name] for name in names))


def decode_position(data: bytes, kind: int) -> tuple[int, ...]:
    """Decode a position of up to 9 axes (usually 44, 48 or 52 bytes) in pulses, or in µm and 1e-4 degrees.

    Raises ``ProtocolError`` for another length, and if the data are not of the requested ``kind``.
    """
    axes = _AXES.get(len(data) - _POSITION_HEAD)
    if axes is None:
        raise ProtocolError(f"a position of {len(data)} bytes; expected 20, and 4 for each of up to 9 axes")
    (found,) = _KIND.unpack_from(data)
    if found != kind:
        raise ProtocolError(f"a position of data type {found}; asked for {kind}")
    return axes.unpack_from(data, _POSITION_HEAD)


def encode_position(kind: int, axes: tuple[int, ...]) -> bytes:
    """Encode a position; its length depends on the number of axes."""
    return _KIND.pack(kind).ljust(_POSITION_HEAD, b"\0") + encode_axes(axes)


def decode_axes(data: bytes) -> tuple[int, ...]:
    """Decode torque counts, or any other table of up to 9 axes. Raises ``ProtocolError`` for another length."""
    axes = _AXES.get(len(data))
    if axes is None:
        raise ProtocolError(f"a torque of {len(data)} bytes; expected 4 for each of up to 9 axes")
    return axes.unpack(data)


def encode_axes(axes: tuple[int, ...]) -> bytes:
    """Encode a table, four bytes per axis."""
    return _AXES[4 * len(axes)].pack(*axes)


def decode_axis_names(data: bytes) -> tuple[str, ...]:
    """Names of the existing axes, e.g. ``S L U R B T``. Raises ``ProtocolError`` unless there are 32 bytes."""
    if len(data) != _NAME_SIZE * _AXIS_SLOTS:
        raise ProtocolError(f"axis names of {len(data)} bytes; expected {_NAME_SIZE * _AXIS_SLOTS}")
    names = (_text(data[i : i + _NAME_SIZE]) for i in range(0, len(data), _NAME_SIZE))
    return tuple(name for name in names if name)


def encode_axis_names(names: tuple[str, ...]) -> bytes:
    """Encode axis names, 32 bytes; absent axes are zero."""
    return b"".join(n.encode("ascii").ljust(_NAME_SIZE, b"\0") for n in names).ljust(_NAME_SIZE * _AXIS_SLOTS, b"\0")


def decode_alarm(data: bytes) -> Alarm:
    """Decode an alarm; its name is in the pendant's Shift-JIS, undecodable bytes become U+FFFD.

    Raises ``ProtocolError`` unless there are 60 bytes.
    """
    code, sub, kind, time, name = _ALARM.unpack(_sized(data, _ALARM, "alarm"))
    return Alarm(code, sub, kind, _text(time), _text(name, "shift_jis"))


def encode_alarm(alarm: Alarm) -> bytes:
    """Encode an alarm, 60 bytes."""
    name = alarm.name.encode("shift_jis", "replace")
    return _ALARM.pack(alarm.code, alarm.data, alarm.kind, alarm.time.encode("ascii", "replace"), name)


def decode_system(data: bytes) -> System:
    """Decode a system information. Raises ``ProtocolError`` unless there are 48 bytes."""
    software, model, parameters = _SYSTEM.unpack(_sized(data, _SYSTEM, "system information"))
    return System(_text(software), _text(model), _text(parameters))


def encode_system(system: System) -> bytes:
    """Encode system information, 48 bytes."""
    return _SYSTEM.pack(system.software.encode(), system.model.encode(), system.parameters.encode())


def _sized(data: bytes, layout: struct.Struct, what: str) -> bytes:
    if len(data) != layout.size:
        raise ProtocolError(f"{what} of {len(data)} bytes; expected {layout.size}")
    return data


def _text(data: bytes, encoding: str = "ascii") -> str:
    return data.split(b"\0", 1)[0].decode(encoding, "replace").strip()
