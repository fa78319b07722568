"""The last minutes of compared frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

Integers = NDArray[np.int64]


class History:
    """A table of the newest ``length`` rows: ``time`` (N,) ns, rising, and ``values`` (N, width).

    Slices are views into the table: they are valid until rows are added.
    """

    def __init__(self, length: int, width: int) -> None:
        self._length = length
        self._time = np.empty(2 * length, np.int64)
        self._values = np.empty((2 * length, width))
        self._end = 0

    def add(self, time: Integers, values: Float) -> None:
        """Append rows; no more than ``length`` at once."""
        if self._end + len(time) > len(self._time):
            stored = self._length - len(time)
            self._time[:stored] = self._time[self._end - stored : self._end]
            self._values[:stored] = self._values[self._end - stored : self._end]
            self._end = stored
        rows = slice(self._end, self._end + len(time))
        self._time[rows], self._values[rows] = time, values
        self._end = rows.stop

    def between(self, start: int, end: int) -> tuple[Integers, Float]:
        """Time (N,) ns and values (N, width) of the rows from ``start`` to ``end`` ns, both included."""
        oldest = max(0, self._end - self._length)
        first, last = oldest + np.searchsorted(self._time[oldest : self._end], [start, end + 1])
        return self._time[first:last], self._values[first:last]
