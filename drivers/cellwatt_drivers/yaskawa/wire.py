"""Frames of the High-Speed Ethernet Server: UDP, little-endian, a 32-byte header before the data.

One request, one answer. The answer repeats the request's number but neither command nor time. ``payload`` decodes the
data of each answer. Source: Yaskawa manual 160766-1CD (FS100), as implemented by public clients.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from cellwatt.errors import ProtocolError

PORT = 10040
HEADER_SIZE = 32

ALARM = 0x70
STATUS = 0x72
AXIS_NAMES = 0x74
POSITION = 0x75
TORQUE = 0x77
SYSTEM = 0x89

GET_ALL = 0x01
SET = frozenset({0x10, 0x02, 0x34})
"""Services that write one, all or several; the driver has no code for them."""
ANSWER = 0x80
"""Bit set in the service of an answer."""

BUSY = frozenset({0xD8F1, 0xD8FA, 0xE444, 0xFFF6})
"""Added statuses of a controller that asks for a later retry."""

_STATUS_TEXT = {
    0x00: "ok",
    0x08: "command not defined",
    0x09: "invalid attribute",
    0x1F: "general error",
    0x28: "instance does not exist",
}
# Codes that a read may get; 0x2100 is the emulator's refusal of a write.
_ADDED_TEXT = {
    0x2100: "remote is not set",
    0x2110: "data cannot be accessed",
    0x3370: "wrong control group",
    0xA000: "command is not defined",
    0xA001: "instance is not defined",
    0xA002: "attribute is not defined",
    0xA100: "answer is too large",
    0xA101: "answer is too large",
    0xB008: "wrong control group",
    0xE28B: "receive time-out",
} | dict.fromkeys(BUSY, "busy")

_IDENTIFIER = b"YERC"
_RESERVE_1 = 3
_RESERVE_2 = b"99999999"
_ROBOT = 1
_SINGLE_BLOCK = 0x80000000
_REQUEST = struct.Struct("<4sHHBBBBI8sHHBBH")
_ANSWER = struct.Struct("<4sHHBBBBI8sBBBBHH")

CONSTANTS = bytes([_RESERVE_1]) + _SINGLE_BLOCK.to_bytes(4, "little") + _RESERVE_2
"""Reserve and block fields as in the manual."""


@dataclass(frozen=True, slots=True)
class Request:
    """One read: the ``command`` and its ``instance`` (control group, alarm number …)."""

    command: int
    instance: int = 1
    attribute: int = 0
    service: int = GET_ALL


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer's header and its data; ``number`` is that of the request, ``status`` 0 means success.

    ``constants`` are the fields that are the same in all answers: reserves and block number.
    """

    number: int
    service: int
    status: int
    added: int
    data: bytes = b""
    constants: bytes = CONSTANTS

    @property
    def busy(self) -> bool:
        """True if the controller asks for a later retry."""
        return self.status != 0 and self.added in BUSY

    @property
    def text(self) -> str:
        """Status and added status in words with their codes."""
        status = f"{_STATUS_TEXT.get(self.status, 'unknown status')} (status 0x{self.status:02X}"
        if self.added:
            status += f", added status 0x{self.added:04X}: {_ADDED_TEXT.get(self.added, 'unknown')}"
        return status + ")"


def encode_request(request: Request, number: int) -> bytes:
    """The datagram of a request without data; ``number`` is 0 … 255."""
    return _REQUEST.pack(
        _IDENTIFIER, HEADER_SIZE, 0, _RESERVE_1, _ROBOT, 0, number, 0, _RESERVE_2,
        request.command, request.instance, request.attribute, request.service, 0,
    )  # fmt: skip


def decode_request(datagram: bytes) -> tuple[Request, int]:
    """Decode a request and its number; its data begin at ``HEADER_SIZE``. Raises ``ProtocolError`` if invalid."""
    if len(datagram) < HEADER_SIZE:
        raise ProtocolError(f"a request of {len(datagram)} bytes; its header alone has {HEADER_SIZE}")
    found = _REQUEST.unpack_from(datagram)
    _check_header(datagram, found, ack=0)
    return Request(found[9], found[10], found[11], found[12]), found[6]


def encode_answer(answer: Answer) -> bytes:
    """The datagram of an answer."""
    reserve, block, reserves = struct.unpack("<BI8s", answer.constants)
    header = _ANSWER.pack(
        _IDENTIFIER, HEADER_SIZE, len(answer.data), reserve, _ROBOT, 1, answer.number, block, reserves,
        answer.service, answer.status, 2 if answer.added else 0, 0, answer.added, 0,
    )  # fmt: skip
    return header + answer.data


def decode_answer(datagram: bytes) -> Answer:
    """Decode an answer of the robot division. Raises ``ProtocolError`` if it is invalid, cut or too long.

    The added status is read whatever its stated size, as in all public clients.
    """
    if len(datagram) < HEADER_SIZE:
        raise ProtocolError(f"an answer of {len(datagram)} bytes; its header alone has {HEADER_SIZE}")
    found = _ANSWER.unpack_from(datagram)
    _check_header(datagram, found, ack=1)
    if not found[9] & ANSWER:
        raise ProtocolError(f"service 0x{found[9]:02X} is not an answer's")
    constants = datagram[8:9] + datagram[12:24]
    return Answer(found[6], found[9], found[10], found[13], datagram[HEADER_SIZE:], constants)


def _check_header(datagram: bytes, found: tuple[int | bytes, ...], ack: int) -> None:
    identifier, header, size, _, division, acknowledge = found[:6]
    if identifier != _IDENTIFIER:
        raise ProtocolError(f"starts with {identifier!r}, not with {_IDENTIFIER!r}")
    if header != HEADER_SIZE or len(datagram) - HEADER_SIZE != size:
        raise ProtocolError(f"states {header!r} + {size!r} bytes but has {len(datagram)}")
    if division != _ROBOT or acknowledge != ack:
        raise ProtocolError(f"division {division!r}, acknowledge {acknowledge!r}; expected {_ROBOT} and {ack}")
