"""Frames on their way to the simulation, which derives a frame's acceleration from the frames before and after it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Bool, Float

Integers = NDArray[np.int64]

CHUNK = 1.0
"""s of frames simulated at once."""
EDGE = 0.4
"""s at both ends of a stretch in which velocity and acceleration are less accurate."""
BRIDGED = 0.1
"""Longest time in s without a value that is interpolated in the motion; a longer one ends a stretch."""


@dataclass(frozen=True)
class Stretch:
    """Frames without a gap: (N,) ns, (N,) sequence numbers, (N, width) values; ``new`` are those not returned before.

    ``bridged`` (N,) is true where a value of the motion was interpolated.
    """

    time: Integers
    sequence: Integers
    values: Float
    bridged: Bool
    new: slice


class Window:
    """Cuts frames into stretches with ``lead`` s of past; blocks may be cut anywhere.

    ``motion`` are the required columns, ``step`` is the grid's step in ns. ``counts`` are the frames left out: those in
    which the motion was ``missing``, and those too near to the ``edge`` of a stretch.
    """

    def __init__(self, motion: list[int], step: int, lead: float) -> None:
        self._motion, self._step = motion, step
        self._chunk = max(8, round(CHUNK * 1e9 / step))
        self._edge = max(5, round(EDGE * 1e9 / step))
        self._most = max(1, round(BRIDGED * 1e9 / step))
        self._lead = max(self._edge, round(lead * 1e9 / step))
        self._parts: list[tuple[Integers, Integers, Float]] = []
        self._waiting = 0
        self.settled = 0
        """ns up to which all frames were returned or left out."""
        self.counts: Counter[str] = Counter()

    def feed(self, time: Integers, sequence: Integers, values: Float) -> Iterator[list[Stretch]]:
        """Add n frames; yield the stretches that can be simulated whenever a chunk is complete."""
        while len(time):
            n = min(len(time), self._chunk - self._waiting)
            self._parts.append((time[:n], sequence[:n], values[:n]))
            self._waiting += n
            time, sequence, values = time[n:], sequence[n:], values[n:]
            if self._waiting == self._chunk:
                self._waiting = 0
                yield self._work()

    def _work(self) -> list[Stretch]:
        """Examine all stored frames: which can be returned, which are lost, and which the next ones still need."""
        time, sequence, values = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        missing = ~np.isfinite(values[:, self._motion]).all(axis=1)
        spans = _spans(time, missing, self._step, self._most)
        given = [s for a, b in spans if (s := self._stretch(time[a:b], sequence[a:b], values[a:b], missing[a:b]))]
        begin, end = spans[-1] if spans else (0, 0)
        goes_on = end >= len(time) - self._most and end > begin
        done = max(begin, end - self._edge) if goes_on else len(time)
        fresh = time[:done] > self.settled
        self.counts["missing"] += int(np.sum(missing[:done] & fresh))
        whole = sum(int(np.sum(~s.bridged[s.new])) for s in given)
        self.counts["edge"] += int(np.sum(~missing[:done] & fresh)) - whole
        if done:
            self.settled = max(self.settled, int(time[done - 1]))
        first = max(begin, done - self._lead) if goes_on else done
        self._parts = [(time[first:], sequence[first:], values[first:])]
        return given

    def _stretch(self, time: Integers, sequence: Integers, values: Float, missing: Bool) -> Stretch | None:
        first = max(self._edge, int(np.searchsorted(time, self.settled, side="right")))
        last = len(time) - self._edge
        if last <= first:
            return None
        return Stretch(time, sequence, bridged(values, self._motion), missing, slice(first, last))


def _spans(time: Integers, missing: Bool, step: int, most: int) -> list[tuple[int, int]]:
    """[start, end) of the stretches of a block without a gap in the grid and without more than ``most`` missing
    rows."""
    present = np.flatnonzero(~missing)
    rows = np.diff(present)
    ends = (rows > most + 1) | (np.diff(time[present]) > rows * step + step // 2)
    parts = np.split(present, np.flatnonzero(ends) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts if len(part)]


def bridged(rows: Float, columns: Sequence[int]) -> Float:
    """Rows (N, width) with missing values of ``columns`` interpolated; each column must have a value."""
    out = rows.copy()
    at = np.arange(len(rows))
    for column in columns:
        good = np.isfinite(rows[:, column])
        if not good.all():
            out[:, column] = np.interp(at, at[good], rows[good, column])
    return out
