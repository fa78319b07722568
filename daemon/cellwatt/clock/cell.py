"""The cell's time: UTC that never steps back."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

_MAX_SLEW = 500e-6
"""Largest relative deviation of the cell's second from the host's."""
_MAX_TURN = 0.05e-6
"""Fastest change of the slew, 1/s: the clock models of the devices follow it without losing their bounds."""
_HORIZON = 20.0
"""Time in s within which small deviations are slewed away, approximately."""
_STEP_NS = 1_000_000
"""The kernel slews CLOCK_REALTIME and CLOCK_BOOTTIME alike; a change of their difference above this is a step."""


def _since_boot() -> int:
    """CLOCK_BOOTTIME, ns: unlike CLOCK_MONOTONIC, it runs on while the PC is suspended."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class CellClock:
    """UTC in ns, anchored to the host's wall clock once and carried on by CLOCK_BOOTTIME.

    Call ``discipline`` once a second: it compares with the host's wall clock and slews towards it by at most
    500 ppm, changed by 0.05 ppm per second. A step of the wall clock is reported and followed by slewing, never
    by a jump. ``wall`` and ``since_boot`` are the host's clocks, ns.
    """

    def __init__(self, wall: Callable[[], int] = time.time_ns, since_boot: Callable[[], int] = _since_boot) -> None:
        self._wall = wall
        self._since_boot = since_boot
        at, utc = self._compare()
        self._difference = utc - at
        self._line = (at, utc, 0.0)
        """Time since boot, ns, the cell's time then, and its rate relative to the host's clock minus 1; replaced as a
        whole, so that other threads may read the time."""
        self.utc_error_ns = 0
        """The cell's time minus the host's UTC at the last ``discipline``, ns."""

    def now(self) -> int:
        """The cell's time, UTC ns; never steps back."""
        at, zero, slew = self._line
        elapsed = self._since_boot() - at
        return zero + elapsed + int(elapsed * slew)

    def discipline(self) -> int:
        """Compare with the host's wall clock and set the slew for the next second.

        Return the step by which the wall clock was set since the last call, ns; 0 if it was not.
        """
        at, utc = self._compare()
        before, zero, slew = self._line
        now = zero + at - before + int((at - before) * slew)
        self.utc_error_ns = now - utc
        self._line = (at, now, _next_slew(slew, self.utc_error_ns / 1e9, (at - before) / 1e9))
        step = utc - at - self._difference
        self._difference = utc - at
        return step if abs(step) >= _STEP_NS else 0

    def _compare(self) -> tuple[int, int]:
        """CLOCK_BOOTTIME and the wall clock at one moment, ns: the closest of three pairs."""
        readings = []
        for _ in range(3):
            before = self._since_boot()
            utc = self._wall()
            after = self._since_boot()
            readings.append((after - before, (before + after) // 2, utc))
        _, at, utc = min(readings)
        return at, utc


def _next_slew(slew: float, error: float, elapsed: float) -> float:
    """The slew that removes ``error`` s without overshoot, within the change that ``elapsed`` s allow."""
    size = min(_MAX_SLEW, math.sqrt(1.6 * _MAX_TURN * abs(error)), abs(error) / _HORIZON)
    wanted = -math.copysign(size, error)
    turn = _MAX_TURN * min(elapsed, 1.0)
    return max(slew - turn, min(slew + turn, wanted))
