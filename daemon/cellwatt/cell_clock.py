"""The cell's time: UTC that never steps back."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

_MAX_SLEW = 500e-6
"""Largest deviation of the cell's second from the host's, 1."""
_HORIZON_NS = 2_000_000_000
"""A deviation is slewed away over two turns of ``discipline``, so that one late turn cannot make it swing."""
_STEP_NS = 1_000_000
"""The kernel slews CLOCK_REALTIME and CLOCK_MONOTONIC alike; a change of their difference above this is a step."""


class Correction(NamedTuple):
    """What one turn of ``CellClock.discipline`` found and did.

    ``step_ns`` is how far somebody set the host's wall clock since the turn before, 0 if nobody did;
    ``slew_change_ppm`` how much faster the cell's time runs from now on than before.
    """

    step_ns: int
    slew_change_ppm: float


class CellClock:
    """UTC in ns, anchored to the host's wall clock once and carried on by CLOCK_MONOTONIC.

    Call ``discipline`` once a second: it compares with the host's wall clock and slews towards it by at most
    500 ppm. A step of the wall clock is reported and then only slewed after, never jumped after. ``wall`` and
    ``monotonic`` are the host's clocks, ns.
    """

    def __init__(
        self, wall: Callable[[], int] = time.time_ns, monotonic: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall = wall
        self._monotonic = monotonic
        at, utc = self._compare()
        self._difference = utc - at
        self._line = (at, utc, 0.0)  # replaced as one, so that other threads may read the time
        self.utc_error_ns = 0
        """The cell's time minus the host's UTC at the last ``discipline``, ns."""
        self.steps = 0
        """Steps of the host's wall clock seen so far."""

    @property
    def slew_ppm(self) -> float:
        """How much faster than the host's clock the cell's time runs at present, ppm."""
        return self._line[2] * 1e6

    def now(self) -> int:
        """The cell's time, UTC ns; never steps back."""
        at, zero, slew = self._line
        elapsed = self._monotonic() - at
        return zero + elapsed + int(elapsed * slew)

    def discipline(self) -> Correction:
        """Compare with the host's wall clock and set the slew for the next second."""
        at, wall = self._compare()
        before, zero, old = self._line
        now = zero + at - before + int((at - before) * old)
        difference = wall - at
        step = difference - self._difference
        if abs(step) < _STEP_NS:
            step = 0
        else:
            self.steps += 1
        self._difference = difference
        self.utc_error_ns = now - wall
        slew = max(-_MAX_SLEW, min(_MAX_SLEW, -self.utc_error_ns / _HORIZON_NS))
        self._line = (at, now, slew)
        return Correction(step, (slew - old) * 1e6)

    def _compare(self) -> tuple[int, int]:
        """CLOCK_MONOTONIC and the wall clock at one moment, ns: the closest of a few readings."""
        readings = []
        for _ in range(3):
            before = self._monotonic()
            wall = self._wall()
            after = self._monotonic()
            readings.append((after - before, (before + after) // 2, wall))
        _, at, wall = min(readings)
        return at, wall
