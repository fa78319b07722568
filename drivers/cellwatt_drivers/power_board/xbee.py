"""XBee API frames, without (AP=1) and with escaping (AP=2), as described in Digi's ZigBee user guides.

    0x7E · length u16 big-endian · frame data (type … last byte) · checksum

The length counts the frame data only; frame data and checksum add up to 0xFF in the low byte. With AP=2 each of 0x7E
0x7D 0x11 0x13 after the first 0x7E is sent as 0x7D and the byte XOR 0x20.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TypeVar

from cellwatt_drivers.power_board.scanner import Decoder, FrameScanner

T = TypeVar("T")

START = b"\x7e"
ESCAPE = b"\x7d"
_SPECIAL = b"\x7e\x7d\x11\x13"
RECEIVE, RECEIVE_EXPLICIT = 0x90, 0x91
MODEM_STATUS = 0x8A

LONGEST = 273
"""Frame data of the longest receive frame: 18 bytes of 0x91 before 255 bytes of payload."""

_LONGEST_ESCAPED = 2 * (2 + LONGEST + 1)
_PAYLOAD_AT = {RECEIVE: 12, RECEIVE_EXPLICIT: 18}
_OTHERS = {  # type → (name, shortest frame data, longest)
    0x88: ("AT response", 5, LONGEST),
    0x89: ("transmit status 16", 3, 3),
    MODEM_STATUS: ("modem status", 2, 2),
    0x8B: ("transmit status", 7, 7),
    0x92: ("IO sample", 16, 30),
    0x95: ("node identification", 31, 64),
    0x97: ("remote AT response", 15, LONGEST),
    0x98: ("extended modem status", 2, LONGEST),
}


def frame(data: bytes, *, escaped: bool = False) -> bytes:
    """The API frame around frame data (type byte first)."""
    body = struct.pack(">H", len(data)) + data + bytes([0xFF - (sum(data) & 0xFF)])
    if escaped:
        body = body.replace(ESCAPE, b"\x7d\x5d")  # first, so that later escapes are not escaped again
        for byte in _SPECIAL.replace(ESCAPE, b""):
            body = body.replace(bytes([byte]), bytes([0x7D, byte ^ 0x20]))
    return START + body


def receive_data(payload: bytes, sender: int, network: int) -> bytes:
    """Frame data 0x90: ``payload`` from a radio's 64-bit ``sender`` and 16-bit ``network`` address."""
    return struct.pack(">BQHB", RECEIVE, sender, network, 0xC1) + payload


def receive_explicit_data(payload: bytes, sender: int, network: int) -> bytes:
    """Frame data 0x91 on the endpoints, cluster and profile of Digi's serial data."""
    return struct.pack(">BQHBBHHB", RECEIVE_EXPLICIT, sender, network, 0xE8, 0xE8, 0x0011, 0xC105, 0xC1) + payload


def _end(buffer: bytes, start: int) -> int:
    """End of the AP=1 frame that begins at ``start``."""
    size = buffer[start + 1] << 8 | buffer[start + 2]
    return start + size + 4 if 1 <= size <= LONGEST else start


def _escaped_end(buffer: bytes, start: int) -> int:
    """End of the AP=2 frame that begins at ``start``; it lies before the next 0x7E, as every one is a start."""
    following = buffer.find(START, start + 1)
    piece = buffer[start + 1 : following if following > 0 else len(buffer)]
    body = _unescape(piece)
    size = (body[0] << 8 | body[1]) + 3 if len(body) > 1 else 4
    if not 4 <= size <= LONGEST + 3:
        return start
    if len(body) < size:
        return len(buffer) + 1 if following < 0 and len(piece) < _LONGEST_ESCAPED else start
    length = size
    while (escaped := size + piece.count(ESCAPE, 0, length)) > length:
        length = escaped
    return start + 1 + length


def _unescape(piece: bytes) -> bytes:
    """The unescaped bytes; a lone escape at the end is dropped until its byte arrives."""
    first, *rest = piece.split(ESCAPE)
    return first + b"".join(bytes([part[0] ^ 0x20]) + part[1:] for part in rest if part)


class ApiDecoder(Decoder[T]):
    """Payloads of receive frames; all other frames are counted by type."""

    def __init__(self, parse: Callable[[bytes], T | None], *, escaped: bool) -> None:
        super().__init__(parse)
        take = self._take_escaped if escaped else self._take_frame
        self.scan = FrameScanner(START, _escaped_end if escaped else _end, take, self.counts).scan

    def _take_escaped(self, frame: bytes) -> bool:
        """Take an AP=2 frame if its bytes that need an escape have one, and no others.

        Without this check most AP=1 frames would pass as AP=2, and a quarter of them would be lost without a hint.
        """
        body = _unescape(frame[1:])
        if frame.count(ESCAPE) == len(body) - len(body.translate(None, _SPECIAL)):
            return self._take_frame(START + body)
        self.counts["checksum"] += 1
        return False

    def _take_frame(self, frame: bytes) -> bool:
        if sum(frame[3:]) & 0xFF == 0xFF:
            return self._open(frame[3:-1])
        self.counts["checksum"] += 1
        return False

    def _open(self, data: bytes) -> bool:
        """Return false if frame data may be a chance hit: its payload does not parse, or its type is unknown."""
        payload_at = _PAYLOAD_AT.get(data[0])
        if payload_at is not None:
            return self._take(data[payload_at:], "foreign payloads")
        name, shortest, longest = _OTHERS.get(data[0], ("", 1, 0))
        known = shortest <= len(data) <= longest
        self.counts[f"frames: {name}" if known else "frames: unknown type"] += 1
        return known
