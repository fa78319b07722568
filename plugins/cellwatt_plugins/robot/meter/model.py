"""Model of a meter: the window of time that each value averages, and the time at which the value is available."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cellwatt.arrays import Float, rows_of


@dataclass(frozen=True)
class Readings:
    """M values of a meter, each once, on the clock of the data that they are compared with."""

    time: Float
    """(M,) s, when each value came."""
    value: Float
    """(M,) W."""
    interval: float
    """s from one value to the next."""


@dataclass(frozen=True)
class Windows:
    """Windows of time that M values average."""

    start: Float
    end: Float
    """(M,) s."""

    @property
    def middle(self) -> Float:
        """(M,) s."""
        return np.asarray((self.start + self.end) / 2)

    def means(self, time: Float, samples: Float) -> Float:
        """Mean of evenly spaced ``samples`` (N,) or (N, k) at ``time`` (N,) s over each window: (M,) or (M, k)."""
        return np.asarray(self.weights(time) @ samples)

    def weights(self, time: Float) -> csr_array:
        """(M, N): how much each of the evenly spaced samples at ``time`` (N,) s counts for the mean of each window.

        A sample holds for half a step either side; the first and the last one hold beyond.
        """
        step = float((time[-1] - time[0]) / (len(time) - 1))
        begin, end = ((edge - time[0]) / step + 0.5 for edge in (self.start, self.end))
        first, last = (np.floor(edge).astype(np.intp) for edge in (begin, end))
        count = last - first + 1
        window = np.repeat(np.arange(len(first)), count)
        row = np.arange(len(window)) - np.repeat(np.cumsum(count) - count, count) + first[window]
        share = np.minimum(row + 1, end[window]) - np.maximum(row, begin[window])
        share = share / (end - begin)[window]
        within = np.clip(row, 0, len(time) - 1)
        return csr_array((share, (window, within)), shape=(len(first), len(time)))

    def inside(self, time: Float) -> NDArray[np.bool_]:
        """(M,) true for windows within ``time`` (N,) s."""
        return np.asarray((self.start >= time[0]) & (self.end <= time[-1]))


@dataclass(frozen=True)
class Meter:
    """Means over ``window`` s, available ``late`` s after its end; the spreads are standard deviations."""

    window: float
    late: float
    interval: float
    """s from one value to the next."""
    window_spread: float = 0.0
    late_spread: float = 0.0
    unexplained: float = 0.0
    """Share of the values' variance that the motion does not explain."""

    @property
    def delay(self) -> float:
        """s from the beginning of a value's window until the value is available."""
        return self.window + self.late

    def windows(self, readings: Readings) -> Windows:
        """Window of each value."""
        end = readings.time - self.late
        return Windows(end - self.window, end)

    def within(self, readings: Readings, time: Float) -> tuple[Windows, Float]:
        """Windows and values (M,) W of the readings whose whole window lies within ``time`` (N,) s."""
        windows = self.windows(readings)
        inside = windows.inside(time)
        return rows_of(windows, inside), readings.value[inside]

    @property
    def description(self) -> str:
        """In words, with 95 % intervals: ``averaged over 100 ± 4 ms and delayed by 152 ± 2 ms``."""
        return f"averaged over {_ms(self.window, self.window_spread)} and delayed by {_ms(self.late, self.late_spread)}"


def _ms(value: float, spread: float) -> str:
    bound = 2e3 * spread
    return f"{1e3 * value:.0f} ms" if bound < 0.5 else f"{1e3 * value:.0f} ± {bound:.0f} ms"
