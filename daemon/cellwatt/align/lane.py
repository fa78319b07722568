"""The columns of one stream in the frames: when a grid point is settled, how long to wait, the method of alignment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.align.methods import Columns, Limits, average, hold, linear
from cellwatt.align.track import NEVER, Track
from cellwatt.batch import Batch
from cellwatt.channel import Align, Quality, Stream

_SECOND = 1_000_000_000
_PLAIN = 1.5
"""Largest distance of neighbouring samples in nominal periods; if it is larger, samples are missing in between."""
_GAP = 3.5
"""Largest distance of neighbouring samples, in nominal periods, that is interpolated."""
_HOLD = 60 * _SECOND
"""Longest time in ns for which a value of a stream without a rate is held."""
_PATIENCE = 1 * _SECOND
"""Frames wait, within the latency, for a stream whose last batch arrived within this time …"""
_PATIENCE_PERIODS = 3
"""… or within this many periods."""
_STEPS = 50
"""Number of steps whose shortest one is the period of a device that sends less often than declared."""


class Lane:
    """Aligns one stream; ``first`` is its first column in the frames.

    ``step`` and ``latency`` ns are those of the frames. The period of a stream that is not held is that of its samples
    if these come less often than declared.
    """

    def __init__(self, stream: Stream, first: int, step: int, latency: int) -> None:
        period = _SECOND / stream.rate if stream.rate else 0.0
        self.held = not stream.rate or period > latency / 2
        """The stream is too slow to wait for its next sample: all channels hold the last one, frames never wait."""
        self.methods: tuple[Align, ...] = tuple(
            "hold" if self.held or c.window * _SECOND > step else c.method for c in stream.channels
        )
        """The method for each channel; a channel that its device averages over more than a step is held."""
        self.reach = step - step // 2 if "average" in self.methods else 0
        """Time in ns past a grid point up to which samples are needed to settle it."""
        self.track = Track(len(stream.channels))
        self.start = NEVER
        """Time from which the stream could have delivered, ns."""
        self._overdue = latency if self.held else 0
        self._limits = Limits(_PLAIN * period + self._overdue, _GAP * period + self._overdue)
        if not stream.rate:
            self._limits = Limits(_HOLD, _HOLD)
        self._period, self._shortest, self._steps = period, -NEVER, 0
        self._step = step
        self._patience = max(_PATIENCE, _PATIENCE_PERIODS * period)
        self._columns = slice(first, first + len(stream.channels))
        self._groups = _groups(self.methods)
        self._heard = NEVER

    @property
    def settled(self) -> int:
        """Time up to which grid points are settled, ns."""
        return self.track.newest - self.reach

    def awaited(self, now: int) -> bool:
        """True if frames should wait for this stream at the cell's time ``now``, ns."""
        return not self.held and now - max(self.start, self._heard) <= self._patience

    def hear(self, batch: Batch, given_out: int, horizon: int) -> None:
        """Add a batch. Frames up to ``given_out`` ns were emitted; samples after ``horizon`` ns are refused."""
        self._heard = batch.arrival
        if not self.held:
            self._learn(batch.time)
        self.track.append(batch, given_out + self.reach - self._overdue, horizon)

    def _learn(self, time: NDArray[np.int64]) -> None:
        """Take the period from the next samples (n,) ns: of many steps, the shortest has no lost sample within."""
        steps = [int(time[0]) - self.track.newest, int((time[1:] - time[:-1]).min(initial=-NEVER))]
        self._shortest = min([self._shortest, *(step for step in steps if step > 0)])
        self._steps += len(time)
        if self._steps >= _STEPS:
            period = self._shortest if self._shortest > _PLAIN * self._period else self._period
            self._limits = Limits(_PLAIN * period, _GAP * period)
            self._shortest, self._steps = -NEVER, 0

    def fill(
        self, grid: NDArray[np.int64], values: NDArray[np.float64], quality: NDArray[np.uint8], bound: NDArray[np.int64]
    ) -> None:
        """Write this stream's columns of the frames at ``grid`` (m,) ns, neighbouring points."""
        if not len(self.track):
            quality[:, self._columns] = Quality.MISSING
            return
        samples = self.track.samples
        mine, my_quality, my_bound = (table[:, self._columns] for table in (values, quality, bound))
        for method, columns in self._groups:
            if method == "average":
                aligned = average(samples, columns, grid, self._step, self._limits)
            else:
                aligned = (linear if method == "linear" else hold)(samples, columns, grid, self._limits)
            mine[:, columns] = aligned.values
            my_quality[:, columns] = aligned.quality[:, None]
            my_bound[:, columns] = aligned.bound[:, None]


def _groups(methods: tuple[Align, ...]) -> tuple[tuple[Align, Columns], ...]:
    """Columns by method; neighbouring ones as a slice, which numpy reads without copying."""
    groups: list[tuple[Align, Columns]] = []
    for method in dict.fromkeys(methods):
        found = np.flatnonzero([m == method for m in methods])
        together = found[-1] - found[0] + 1 == len(found)
        groups.append((method, slice(int(found[0]), int(found[-1]) + 1) if together else found))
    return tuple(groups)
