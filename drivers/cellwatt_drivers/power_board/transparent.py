"""Our framing for the receiver's transparent mode (AP=0), where bytes in are bytes out.

    0xA5 0x5A · length u8 · length XOR 0xFF · payload (length bytes)

The radio may split and merge what it is given, and a lost radio packet takes bytes out of the middle. So the
length is sent twice (a false start is seen at once and holds nothing up) and the payload's CRC decides.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

SYNC = b"\xa5\x5a"


def frame(payload: bytes) -> bytes:
    """The framed payload; raises ``ValueError`` above 255 bytes."""
    if not 1 <= len(payload) <= 255:
        raise ValueError(f"a payload of {len(payload)} bytes cannot be framed: 1 to 255")
    return SYNC + bytes([len(payload), len(payload) ^ 0xFF]) + payload


class TransparentDecoder(Generic[T]):
    """Takes bytes in pieces of any size and gives what ``parse`` made of the payloads in them.

    Where ``parse`` refuses a payload the scan goes on one byte past its start, in the same bytes. What
    waits for more bytes is never longer than one frame. ``counts`` as in ``xbee``.
    """

    def __init__(self, parse: Callable[[bytes], T | None]) -> None:
        self.counts: Counter[str] = Counter()
        self._parse = parse
        self._rest = b""

    def feed(self, data: bytes) -> list[T]:
        """All payloads completed by these bytes, in order."""
        buffer = self._rest + data
        found: list[T] = []
        end, taken = len(buffer), 0
        at = buffer.find(SYNC)
        while at >= 0 and at + 4 <= end:
            size = buffer[at + 2]
            if size ^ buffer[at + 3] == 0xFF:
                stop = at + 4 + size
                if stop > end:
                    break
                result = self._parse(buffer[at + 4 : stop])
                if result is not None:
                    found.append(result)
                    if at > taken:
                        self.counts["garbage bytes"] += at - taken
                    taken = stop
                    at = buffer.find(SYNC, stop)
                    continue
                self.counts["checksum"] += 1
            at = buffer.find(SYNC, at + 1)
        if at < 0:
            at = end - 1 if buffer.endswith(SYNC[:1]) and taken < end else end
        if at > taken:
            self.counts["garbage bytes"] += at - taken
        self._rest = buffer[at:]
        return found
