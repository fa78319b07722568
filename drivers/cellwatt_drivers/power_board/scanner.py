"""Finds frames in bytes that arrive in pieces of any size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class FrameScanner:
    """Frames that begin with ``start``, of five bytes and more.

    ``end`` returns where in a buffer the frame ends that begins at an index: the index itself if no frame begins there,
    beyond the buffer if it is not complete.

    A start sequence may occur in data, and a checksum may match by chance. So a frame is consumed only if ``take``
    accepts it; otherwise the scan continues one byte after the start, in the same bytes. An incomplete rest is never
    longer than one frame.
    """

    def __init__(
        self, start: bytes, end: Callable[[bytes, int], int], take: Callable[[bytes], bool], counts: Counter[str]
    ) -> None:
        self._start = start
        self._end = end
        self._take = take
        self._counts = counts
        self._rest = b""

    def scan(self, data: bytes) -> None:
        """Process all frames completed by these bytes, in order."""
        buffer = self._rest + data
        end, used = len(buffer), 0
        at = buffer.find(self._start)
        while 0 <= at <= end - 4:
            stop = self._end(buffer, at)
            if stop > end:
                break
            if stop > at and self._take(buffer[at:stop]):
                self._pass_over(at - used)
                used = stop
                at = buffer.find(self._start, stop)
            else:
                at = buffer.find(self._start, at + 1)
        if at < 0:
            at = end - 1 if buffer.endswith(self._start[:1]) and used < end else end
        self._pass_over(at - used)
        self._rest = buffer[at:]

    def _pass_over(self, count: int) -> None:
        if count:
            self._counts["garbage bytes"] += count


class Decoder(Generic[T]):
    """Returns payloads parsed by ``parse`` (``None``: invalid) from the frames of a mode, which ``scan`` finds.

    Bytes arrive in pieces of any size. ``counts`` counts everything except valid payloads; its reader clears it.
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
        """Store a parsed payload; count an invalid one as ``otherwise``."""
        if (result := self._parse(payload)) is None:
            self.counts[otherwise] += 1
            return False
        self._found.append(result)
        return True
