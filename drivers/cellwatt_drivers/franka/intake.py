"""From states to the daemon: losses by the robot's milliseconds and their causes, its clock, its mode."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Losses
from cellwatt.arrays import Float
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Inlet
from cellwatt.slots import HOST
from cellwatt_drivers.franka.fields import MODE, MODES
from cellwatt_drivers.shared.states import State, StateWatch

_SETTLED, _FORGOTTEN = 100, 1000
"""Time without a loss, ms, after which losses are counted, and after which the reader's delays are discarded: the
kernel counts delays in steps of 10 ms, and a tick late.
"""
_STRANGE = 500.0
"""Deviation of the robot's time from this PC's between two blocks, ms, that means a new time base."""


class Intake:
    """Takes the states of one robot in order, over all connections, and counts them in its account.

    ``every`` is the step in ms between two states that are read. The robot's time counts ms since its start.
    """

    def __init__(self, inlet: Inlet, stream: Stream, every: int) -> None:
        self.stream = stream
        self._inlet = inlet
        self._every = every
        self._last: int | None = None
        self._arrival = 0
        self._losses = Losses(inlet.account)
        self._missing, self._held, self._since = 0, 0.0, 0
        self._states = StateWatch(inlet, stream, {MODE: State("mode", "robot mode", MODES)})

    def opened(self) -> None:
        """Mark that losses before the next state belong to an outage."""
        self.settle()
        self._losses.resumed = True

    def take(self, stamps: NDArray[np.int64], held: Float, values: Float) -> None:
        """Take states with the robot's times (n,) ms and values (n, channels).

        ``held`` (n,) ms: delay of the reader by the host since the state before.
        """
        arrival, steps = self._inlet.now(), np.diff(stamps)
        passed = (arrival - self._arrival) / 1e6 if self._last is not None else 0.0
        breaks = [0, *(np.flatnonzero((steps <= 0) | (steps - passed > _STRANGE)) + 1).tolist(), len(stamps)]
        for start, end in pairwise(breaks):
            self._take(stamps[start:end], held[start:end], values[start:end], arrival)

    def _take(self, stamps: NDArray[np.int64], held: Float, values: Float, arrival: int) -> None:
        """Take states of one time base, with rising times."""
        first = int(stamps[0])
        if self._last is not None:
            passed, ahead = first - self._last, first - self._last - (arrival - self._arrival) / 1e6
            # The first states of a connection have not waited: only a robot that restarted meanwhile is behind.
            behind = self._losses.resumed and ahead + int(stamps[-1]) - first < -_STRANGE
            if passed <= 0 or ahead > _STRANGE or behind:
                self._inlet.clock_reset(self.stream, "the robot's time began anew")
                self._last = None
        before = first - self._every if self._last is None else self._last
        steps = np.diff(stamps, prepend=before)
        missing = steps // self._every - 1
        if self._losses.resumed:
            self._losses.before_next(int(missing[0]))
            missing[0] = 0
        self._inlet.account.expect(len(stamps))
        self._note(missing, held, stamps)
        self._last, self._arrival = int(stamps[-1]), arrival
        self._inlet.emit(Reading(self.stream, values, arrival, stamps * 1_000_000))
        self._states.see(values)

    def _note(self, missing: NDArray[np.int64], held: Float, stamps: NDArray[np.int64]) -> None:
        """Add the states missing before each state, and count them by cause once no more are lost."""
        self._held += float(held.sum())
        if missing.any():
            self._missing += int(missing.sum())
            self._since = int(stamps[-1])
        elif not 0 <= stamps[-1] - self._since < (_SETTLED if self._missing else _FORGOTTEN):
            self.settle()
            self._since = int(stamps[-1])

    def settle(self) -> None:
        """Count missing states: as many as the reader's delay explains as the host's, the rest as gaps."""
        host = min(self._missing, round(self._held / self._every))
        self._inlet.account.lose(host, HOST)
        self._inlet.account.lose(self._missing - host, "gap")
        self._missing, self._held = 0, 0.0
