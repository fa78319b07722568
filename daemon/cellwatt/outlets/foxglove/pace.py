"""Frames come in blocks; the app draws a message where it arrives, so they go out at the pace of their times."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Final

from cellwatt.outlets.foxglove.topics import Moment

LAG: Final = 0.5
"""s by which a moment is held back so that it keeps its distance; what comes faster than that is hurried."""
HURRY: Final = 1 / 2000
"""s between hurried moments: the library keeps some thousand messages a client, and more at once would be lost."""
MOST: Final = 20_000
"""Moments that wait; the oldest of more are dropped."""


class Pace:
    """Moments in their order, each due ``after`` s behind the one before it; times are monotonic, in s."""

    def __init__(self) -> None:
        self.dropped = 0
        self._waiting: deque[tuple[float, Moment]] = deque()
        self._last = -math.inf

    def add(self, moment: Moment, now: float) -> None:
        """Take a moment."""
        at = max(now, self._last + moment.after)
        if at > now + LAG:
            at = max(now, self._last + min(moment.after, HURRY))
        self._last = at
        self._waiting.append((at, moment))
        if len(self._waiting) > MOST:
            self._waiting.popleft()
            self.dropped += 1

    def due(self, now: float) -> Iterator[Moment]:
        """Take out the moments that are due."""
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]

    def wait(self, now: float) -> float:
        """Time in s until the next moment is due; infinite without one."""
        return max(0.0, self._waiting[0][0] - now) if self._waiting else math.inf
