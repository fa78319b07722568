"""From states to the daemon: losses by the robot's own milliseconds, its clock, its mode."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Outlet
from cellwatt_drivers.franka.fields import MODE, MODES

Float = NDArray[np.float64]

_STRANGE = 500.0
"""ms by which the robot's time and this PC's may run apart between two blocks before it counts as set anew."""


class Intake:
    """Takes the states of one robot in order, over all connections, and keeps its account.

    ``every`` is the step in ms between two states that are kept. The robot's time counts ms since its start.
    """

    def __init__(self, outlet: Outlet, stream: Stream, every: int) -> None:
        self.stream = stream
        self._outlet = outlet
        self._every = every
        self._last: int | None = None
        self._arrival = 0
        self._reason = "gap"
        self._mode_column = stream.names.index(MODE) if MODE in stream.names else None
        self._mode: float | None = None

    def opened(self) -> None:
        """Losses before the next state are those of an outage."""
        self._reason = "outage"

    def take(self, stamps: NDArray[np.int64], values: Float) -> None:
        """States with the robot's times (n,) ms and values (n, channels)."""
        steps = np.diff(stamps)
        breaks = [0, *(np.flatnonzero((steps <= 0) | (steps > _STRANGE)) + 1).tolist(), len(stamps)]
        for start, end in pairwise(breaks):
            self._take(stamps[start:end], values[start:end])

    def _take(self, stamps: NDArray[np.int64], values: Float) -> None:
        """States of one time base, rising."""
        arrival = self._outlet.now()
        account = self._outlet.account
        first = int(stamps[0])
        if self._last is not None and self._strange(first, arrival):
            self._outlet.clock_reset(self.stream, "the robot's time began anew")
            self._last = None
        missing = 0 if self._last is None else (first - self._last) // self._every - 1
        account.miss(missing, self._reason)
        self._reason = "gap"
        inside = int((np.diff(stamps) // self._every - 1).sum())
        account.miss(inside, "gap")
        account.expect(len(stamps) + missing + inside)
        self._last, self._arrival = int(stamps[-1]), arrival
        self._outlet.emit(Reading(self.stream, values, arrival, stamps * 1_000_000))
        self._compare(values)

    def _strange(self, first: int, arrival: int) -> bool:
        assert self._last is not None
        passed = first - self._last
        return passed <= 0 or passed - (arrival - self._arrival) / 1e6 > _STRANGE

    def _compare(self, values: Float) -> None:
        """Report changes of the robot's mode."""
        if self._mode_column is None:
            return
        modes = values[:, self._mode_column]
        before = modes[0] if self._mode is None else self._mode
        self._mode = float(modes[-1])
        for mode in modes[np.flatnonzero(np.diff(modes, prepend=before))]:
            old, new = (MODES.get(m, f"{m:g}") for m in (before, mode))
            before = mode
            self._outlet.event("mode", f"robot mode: {old} → {new}", before=old, after=new)
