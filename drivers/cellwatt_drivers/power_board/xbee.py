"""XBee API frames, without (AP=1) and with escaping (AP=2), as described in Digi's ZigBee user guides.

    0x7E · length u16 big-endian · frame data (type … last byte) · checksum

The length counts the frame data only; frame data and checksum add up to 0xFF in the low byte. With AP=2 each of 0x7E
0x7D 0x11 0x13 after the first 0x7E is sent as 0x7D and the byte XOR 0x20.
"""

from __future__ import annotations

import struct
from collections import Counter
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


def api_frames(accept: Callable[[bytes], bool], counts: Counter[str]) -> FrameScanner:
    """Finds AP=1 frames and passes the data of each to ``accept``; ``counts`` counts damage."""

    def take(frame: bytes) -> bool:
        if sum(frame[3:]) & 0xFF != 0xFF:
            counts["checksum"] += 1
            return False
        return accept(frame[3:-1])

    return FrameScanner(START, _length, take, counts)


def _length(head: bytes) -> int:
    size = head[1] << 8 | head[2]
    return size + 4 if 1 <= size <= LONGEST else 0


class EscapedApiFrames:
    """Like ``api_frames``, for AP=2, where every 0x7E is a start."""

    def __init__(self, accept: Callable[[bytes], bool], counts: Counter[str]) -> None:
        self._accept = accept
        self._counts = counts
        self._rest = b""

    def scan(self, data: bytes) -> None:
        """Process all frames completed by these bytes, in order."""
        before, *pieces = (self._rest + data).split(START)
        self._rest = b""
        if before:
            self._counts["garbage bytes"] += len(before)
        for piece in pieces[:-1]:
            if not self._take(piece):
                self._damaged(piece)
        if pieces and not self._take(pieces[-1]):
            self._rest = START + pieces[-1]

    def _take(self, piece: bytes) -> bool:
        """Process the bytes after a 0x7E; false if they are incomplete."""
        body = _unescape(piece) if ESCAPE in piece else piece
        size = body[0] << 8 | body[1] if len(body) >= 2 else 1
        stop = size + 3
        if len(body) < stop <= LONGEST + 3 and len(piece) < _LONGEST_ESCAPED:
            return False
        good = 1 <= size <= LONGEST and len(body) >= stop and sum(body[2:stop]) & 0xFF == 0xFF
        if good and _well_escaped(piece, body[:stop]):
            self._accept(body[2 : stop - 1])
            if len(body) > stop:
                self._counts["garbage bytes"] += len(body) - stop
        else:
            self._damaged(piece)
        return True

    def _damaged(self, piece: bytes) -> None:
        self._counts["checksum"] += 1
        self._counts["garbage bytes"] += 1 + len(piece)


def _unescape(piece: bytes) -> bytes:
    """The unescaped bytes; a lone escape at the end is dropped until its byte arrives."""
    first, *rest = piece.split(ESCAPE)
    return first + b"".join(bytes([part[0] ^ 0x20]) + part[1:] for part in rest if part)


def _well_escaped(piece: bytes, body: bytes) -> bool:
    """True if the bytes of ``body`` in ``piece`` have an escape for each byte that needs one.

    Without this check most AP=1 frames would pass as AP=2, and a quarter of them would be lost without a hint.
    """
    special = len(body) - len(body.translate(None, _SPECIAL))
    return piece.count(ESCAPE, 0, len(body) + special) == special


class ApiDecoder(Decoder[T]):
    """Payloads of receive frames; all other frames are counted by type."""

    def __init__(self, parse: Callable[[bytes], T | None], *, escaped: bool) -> None:
        super().__init__(parse)
        self.scan = (EscapedApiFrames if escaped else api_frames)(self._open, self.counts).scan

    def _open(self, data: bytes) -> bool:
        """Return false if frame data may be a chance hit: its payload does not parse, or its type is unknown."""
        payload_at = _PAYLOAD_AT.get(data[0])
        if payload_at is not None:
            return self._take(data[payload_at:], "foreign payloads")
        name, shortest, longest = _OTHERS.get(data[0], ("", 1, 0))
        known = shortest <= len(data) <= longest
        self.counts[f"frames: {name}" if known else "frames: unknown type"] += 1
        return known
