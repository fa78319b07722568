"""Counters that wrap or are set back, as ones that only rise."""

from __future__ import annotations

import math
from typing import Literal

Fall = Literal["wrapped", "reset"]

_NEAR = 0.1
"""Share of a counter's range, from either end, within which a fall across the end is taken for a wrap."""


class RisingCounter:
    """Adds up what a counter counted since its first reading; ``wraps_at`` is the value at which it begins anew.

    The first reading is given as it is. A fall from near ``wraps_at`` to near 0 is a wrap, and nothing is lost; any
    other is a reset: counting goes on from the last value, and what was counted between the two readings is lost.
    """

    def __init__(self, wraps_at: float | None) -> None:
        self._range = wraps_at
        self._last = math.nan
        self._added = 0.0

    def take(self, reading: float) -> tuple[float, Fall | None]:
        """The value that only rises, and whether the reading fell; NaN passes through."""
        fall: Fall | None = None
        if reading < self._last:
            full = self._range
            if full is not None and (1 - _NEAR) * full < self._last <= full and reading < _NEAR * full:
                fall = "wrapped"
                self._added += full
            else:
                fall = "reset"
                self._added += self._last - reading
        if not math.isnan(reading):
            self._last = reading
        return reading + self._added, fall
