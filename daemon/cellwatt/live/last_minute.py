"""Values of the last minute, as arrays."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

SPAN: Final = 60 * 10**9
"""Time span, ns, that is stored."""
_MOST: Final = 2_000_000
"""Largest number of stored values, so that a thousand channels at 1 kHz do not fill the memory."""


class LastMinute:
    """Values of the last ``SPAN`` of columns with common times; less if they exceed two million values."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self._blocks: deque[tuple[NDArray[np.int64], NDArray[np.float64]]] = deque()
        self._rows = 0

    def add(
        self, time: NDArray[np.int64], names: Sequence[str], units: Sequence[str], values: NDArray[np.float64]
    ) -> None:
        """Append ``values`` (n, names) at ``time`` (n,), ns.

        Different names discard all stored values; times that went back discard the stored values after them.
        """
        if tuple(names) != self.names:
            self.names, self.units, self._rows = tuple(names), tuple(units), 0
            self._blocks.clear()
        if not len(time):
            return
        while self._blocks and self._blocks[-1][0][-1] >= time[0]:
            before, old = self._blocks.pop()
            remaining = int(np.searchsorted(before, time[0]))
            self._rows -= len(before) - remaining
            if remaining:
                self._blocks.append((before[:remaining], old[:remaining]))
        self._blocks.append((time, values))
        self._rows += len(time)
        while len(self._blocks) > 1 and (
            self._blocks[0][0][-1] < time[-1] - SPAN or self._rows * len(self.names) > _MOST
        ):
            self._rows -= len(self._blocks.popleft()[0])

    @property
    def time(self) -> NDArray[np.int64]:
        """Times (n,), ns, increasing."""
        return np.concatenate([np.empty(0, np.int64), *(time for time, _ in self._blocks)])

    @property
    def values(self) -> NDArray[np.float64]:
        """Values (n, names), NaN if missing."""
        return np.concatenate([np.empty((0, len(self.names))), *(values for _, values in self._blocks)])
