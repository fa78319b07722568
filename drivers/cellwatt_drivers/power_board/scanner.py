"""Finds frames in bytes that come in pieces of any size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class FrameScanner:
    """Frames that begin with ``start``; ``length`` tells from the first four bytes how long one is, 0 where it is none.

    A start may be data, and a checksum is right by chance now and then. So a frame is taken off only when ``take`` says
    that it is one; otherwise the scan goes on one byte past the start, in the same bytes. What waits for more bytes is
    never longer than one frame.
    """

    def __init__(
        self, start: bytes, length: Callable[[bytes], int], take: Callable[[bytes], bool], counts: Counter[str]
    ) -> None:
        self._start = start
        self._length = length
        self._take = take
        self._counts = counts
        self._rest = b""

    def scan(self, data: bytes) -> None:
        """Take all frames completed by these bytes, in order."""
        buffer = self._rest + data
        end, taken = len(buffer), 0
        at = buffer.find(self._start)
        while 0 <= at <= end - 4:
            stop = at + self._length(buffer[at : at + 4])
            if stop > end:
                break
            if stop > at and self._take(buffer[at:stop]):
                self._pass_over(at - taken)
                taken = stop
                at = buffer.find(self._start, stop)
            else:
                at = buffer.find(self._start, at + 1)
        if at < 0:
            at = end - 1 if buffer.endswith(self._start[:1]) and taken < end else end
        self._pass_over(at - taken)
        self._rest = buffer[at:]

    def _pass_over(self, count: int) -> None:
        if count:
            self._counts["garbage bytes"] += count


class Decoder(Generic[T]):
    """Gives what ``parse`` made of payloads, ``None`` for what is none, in the frames of a mode, which ``scan`` finds.

    Bytes come in pieces of any size. ``counts`` is what was seen besides good payloads; whoever reads it clears it.
    """

    scan: Callable[[bytes], None]

    def __init__(self, parse: Callable[[bytes], T | None]) -> None:
        self.counts: Counter[str] = Counter()
        self._parse = parse
        self._found: list[T] = []

    def feed(self, data: bytes) -> list[T]:
        """All payloads completed by these bytes, in order."""
        self._found = []
        self.scan(data)
        return self._found

    def _take(self, payload: bytes, otherwise: str) -> bool:
        """Keep what is made of a payload; where it is none, count that as ``otherwise``."""
        if (result := self._parse(payload)) is None:
            self.counts[otherwise] += 1
            return False
        self._found.append(result)
        return True
