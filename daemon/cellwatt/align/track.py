"""The samples of one stream that coming frames need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt.align.methods import Samples
from cellwatt.batch import Batch

NEVER = -(2**62)
"""A time, ns, before any other."""
_ROWS = 64


@dataclass(slots=True)
class Counts:
    """Counts of samples that did not enter their frames; the record has them all.

    ``late`` arrived after their frames had been emitted, ``ahead`` had times further in the future than the
    latency allows, ``replaced`` were unused when the stream's time went back past them.
    """

    late: int = 0
    ahead: int = 0
    replaced: int = 0


class Track:
    """A window over one stream, in contiguous arrays that grow as needed."""

    def __init__(self, channels: int) -> None:
        self.counts = Counts()
        self.newest = NEVER
        """Time of the newest sample, ns."""
        self._first = self._end = 0
        self._resize(_ROWS, channels)

    def __len__(self) -> int:
        return self._end - self._first

    @property
    def samples(self) -> Samples:
        """Views of the held samples, oldest first."""
        rows = slice(self._first, self._end)
        return Samples(self._time[rows], self._bound[rows], self._values[rows], self._quality[rows])

    def append(self, batch: Batch, settled: int, horizon: int) -> None:
        """Add a batch. Samples at or before ``settled`` ns are late, those after ``horizon`` ns are refused."""
        time = batch.time
        n = len(time)
        first, last = int(time[0]), int(time[-1])
        if last > horizon:
            n = int(time.searchsorted(horizon, side="right"))
            self.counts.ahead += len(time) - n
            if n == 0:
                return
            last = int(time[n - 1])
        if first <= self.newest:
            keep = self._first + int(self._time[self._first : self._end].searchsorted(first))
            self.counts.replaced += self._end - keep
            self._end = keep
        if first <= settled:
            self.counts.late += int(time[:n].searchsorted(settled, side="right"))
        if self._end + n > len(self._time):
            self._pack(n)
        rows = slice(self._end, self._end + n)
        self._time[rows] = time[:n]
        self._bound[rows] = batch.bound[:n]
        self._values[rows] = batch.values[:n]
        self._quality[rows] = batch.quality[:n]
        self._end += n
        self.newest = last

    def forget(self, before: int) -> None:
        """Discard all samples before ``before`` ns except the last of them."""
        older = int(self._time[self._first : self._end].searchsorted(before, side="right"))
        self._first += max(0, older - 1)

    def _pack(self, room: int) -> None:
        """Move the held samples to the front, into larger arrays if they fill more than half."""
        held = self.samples
        if 2 * (len(self) + room) > len(self._time):
            self._resize(4 * (len(self) + room), held.values.shape[1])
        n = len(held.time)
        self._time[:n], self._bound[:n] = held.time.copy(), held.bound.copy()
        self._values[:n], self._quality[:n] = held.values.copy(), held.quality.copy()
        self._first, self._end = 0, n

    def _resize(self, rows: int, channels: int) -> None:
        self._time = np.empty(rows, np.int64)
        self._bound = np.empty(rows, np.int64)
        self._values = np.empty((rows, channels))
        self._quality = np.empty(rows, np.uint8)
