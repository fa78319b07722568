"""Order and pace in which questions are answered: those about now first, those about the past at a limited rate.

What a consumer missed may be days of samples, and leaves by the same line as what happens now. With a limit the line
is never full of the past; pieces are small enough that one who waits for the next does not give up first.
"""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable
from typing import Final

Work = Callable[[], None]

_PIECE: Final = 0.25
"""Longest time, s, that one answer about the past may take at the limit …"""
_ROUND: Final = 2.0
"""… and all that wait now together: whoever asks waits 5 s for an answer."""


class Pace:
    """Lets ``rate`` bytes a second go on average, one piece at a time; ``None`` lets all go at once."""

    def __init__(self, rate: float | None) -> None:
        self._rate = rate
        self._free_at = 0.0

    def delay(self, now: float) -> float:
        """Time, s, until the next piece may go."""
        return max(self._free_at - now, 0.0)

    def spend(self, size: int, now: float) -> None:
        """Note that a piece of ``size`` bytes goes now."""
        if self._rate is not None:
            self._free_at = max(self._free_at, now) + size / self._rate

    def piece(self, waiting: int) -> float:
        """Most bytes of one answer while ``waiting`` more questions wait; infinite without a limit."""
        return float("inf") if self._rate is None else self._rate * min(_PIECE, _ROUND / (1 + waiting))


class Turns:
    """Questions that wait for the answering thread, at most ``limit``.

    ``held_back`` is called for each question about the past that the limit made wait.
    """

    def __init__(self, pace: Pace, limit: int, held_back: Callable[[], None]) -> None:
        self._pace = pace
        self._limit = limit
        self._held_back = held_back
        self._arrived: queue.SimpleQueue[tuple[Work, bool] | None] = queue.SimpleQueue()
        self._past: deque[Work] = deque()

    def put(self, work: Work, past: bool) -> bool:
        """Add the answering of a question; return False if there is no room. Never blocks."""
        if self._arrived.qsize() + len(self._past) >= self._limit:
            return False
        self._arrived.put((work, past))
        return True

    def end(self) -> None:
        """Make ``take`` return ``None``."""
        self._arrived.put(None)

    def take(self) -> Work | None:
        """Wait for the next question to answer; ``None`` at the end. For one thread."""
        while True:
            try:
                arrived = self._arrived.get(timeout=self._pace.delay(time.monotonic()) if self._past else None)
            except queue.Empty:
                return self._past.popleft()
            if arrived is None:
                return None
            work, past = arrived
            if not past:
                return work
            if self._past or self._pace.delay(time.monotonic()) > 0:
                self._held_back()
            self._past.append(work)

    @property
    def waiting(self) -> int:
        """Questions about the past that wait."""
        return len(self._past)
