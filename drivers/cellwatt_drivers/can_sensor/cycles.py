"""Messages that were lost before one that came, counted from its counter and the time."""

from __future__ import annotations

from collections import deque

DUPLICATE = -1
_WINDOW = 16
"""Messages in a row that must be behind before a loss that only the time shows is believed."""
_CREEP = 0.02
"""Share of a cycle by which messages may fall behind from one to the next without a loss: a slow sensor clock."""


class Cycle:
    """Watches one message: ``period`` s from one to the next (0: unknown), its counter runs 0 … ``counts_to`` - 1.

    The counter tells at once how many were lost, except for whole rounds of it. Those, and all losses of a message
    without a counter, show in the time: what comes after stays behind. What was only late (an adapter or a PC that
    stalled) catches up, and is no loss.
    """

    def __init__(self, period: float, counts_to: int | None) -> None:
        self._period = period
        self._counts_to = counts_to
        self._round = counts_to or 1
        self._start: float | None = None
        self._time = 0.0
        self._count = 0
        self._number = 0
        self._earliest = 0.0
        self._behind: deque[tuple[float, float]] = deque(maxlen=_WINDOW)  # when, and by how much; cycles

    def lost(self, time: float, count: int, resumed: bool = False) -> int:
        """Messages newly known as lost when one made at ``time`` s came with the counter at ``count``.

        ``resumed``: nobody listened since the last one, so that the time between them is believed at once.
        ``DUPLICATE`` where it is the last one once more.
        """
        if self._start is None:
            self._start = self._time = time
            self._count = count
            return 0
        cycles = (time - self._time) / self._period if self._period else 0.0
        step = (count - self._count) % self._round
        if step == 0:
            if self._counts_to is not None and cycles < self._round / 2:
                return DUPLICATE
            step = self._round
        self._time, self._count = time, count
        if resumed:
            step += self._round * max(0, round((cycles - step) / self._round))
        self._number += step
        return step - 1 + self._rounds(time - self._start, resumed)

    def _rounds(self, elapsed: float, resumed: bool) -> int:
        """Messages in whole rounds of the counter that the time shows to be lost."""
        if not self._period:
            return 0
        now = elapsed / self._period
        offset = now - self._number
        if resumed:
            self._earliest = offset
            self._behind.clear()
        self._earliest = min(offset, self._earliest + _CREEP)
        self._behind.append((now, offset - self._earliest))
        if len(self._behind) < _WINDOW or now - self._behind[0][0] < _WINDOW / 2:
            return 0  # too few, or they come so fast that they are catching up
        lost = self._round * round(min(behind for _, behind in self._behind) / self._round)
        if lost:
            self._number += lost
            self._behind.clear()
        return lost
