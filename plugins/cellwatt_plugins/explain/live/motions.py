"""Motions that recur: intervals in which the same joints move the same distance from the same pose in the same time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from cellwatt.results import Interval

SAME_WAY = math.radians(2.0)
SAME_POSE = math.radians(6.0)
SAME_TIME = 0.10
"""Largest difference of displacements and starts (rad), and of durations (a share), within one motion."""
MOST = 256
"""Largest number of stored motions; the one unseen for longest is discarded."""


@dataclass
class Motions:
    """Numbers motions in the order in which they are first seen."""

    _known: dict[int, Interval] = field(default_factory=dict)
    _next: int = 0

    def number(self, interval: Interval) -> int:
        """The number of an interval's motion."""
        number = next((n for n, other in self._known.items() if _same(interval, other)), None)
        if number is None:
            number, self._next = self._next, self._next + 1
        self._known[number] = self._known.pop(number, interval)
        if len(self._known) > MOST:
            del self._known[next(iter(self._known))]
        return number


def _same(a: Interval, b: Interval) -> bool:
    return (
        a.moving == b.moving
        and _near(a.displacement, b.displacement, SAME_WAY)
        and _near(a.pose, b.pose, SAME_POSE)
        and abs(a.end - a.start - (b.end - b.start)) <= SAME_TIME * (b.end - b.start)
    )


def _near(a: Sequence[float], b: Sequence[float], most: float) -> bool:
    return len(a) == len(b) and all(abs(x - y) <= most for x, y in zip(a, b, strict=True))
