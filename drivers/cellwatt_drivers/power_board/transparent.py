"""Our framing for the receiver's transparent mode (AP=0), which passes bytes unchanged.

    0xA5 0x5A · length u8 · length XOR 0xFF · payload (length bytes)

The radio may split and merge data, and a lost radio packet removes bytes from the middle. So the length is sent twice
(a false start is detected at once and delays nothing) and the payload's CRC decides.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from cellwatt_drivers.power_board.scanner import Decoder, FrameScanner

T = TypeVar("T")
SYNC = b"\xa5\x5a"


def frame(payload: bytes) -> bytes:
    """The framed payload; raises ``ValueError`` above 255 bytes."""
    if not 1 <= len(payload) <= 255:
        raise ValueError(f"a payload of {len(payload)} bytes cannot be framed: 1 to 255")
    return SYNC + bytes([len(payload), len(payload) ^ 0xFF]) + payload


class TransparentDecoder(Decoder[T]):
    """Payloads in bytes of the transparent mode."""

    def __init__(self, parse: Callable[[bytes], T | None]) -> None:
        super().__init__(parse)
        self.scan = FrameScanner(SYNC, _end, lambda frame: self._take(frame[4:], "checksum"), self.counts).scan


def _end(buffer: bytes, start: int) -> int:
    """End of the frame that begins at ``start``."""
    size, inverted = buffer[start + 2], buffer[start + 3]
    return start + 4 + size if size ^ inverted == 0xFF else start
