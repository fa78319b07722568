"""What a meter does to power: the time that each value stands for, and when it is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.accumulate import Accumulated

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Readings:
    """M values of a meter, each only once, on the clock of what they are compared with."""

    time: Float
    """(M,) s, when each came."""
    value: Float
    """(M,) W."""
    interval: float
    """s from one to the next."""


@dataclass(frozen=True)
class Windows:
    """The times that M values stand for."""

    start: Float
    end: Float
    """(M,) s."""

    @property
    def middle(self) -> Float:
        """(M,) s."""
        return np.asarray((self.start + self.end) / 2)

    def means(self, time: Float, samples: Float) -> Float:
        """Mean of evenly spaced ``samples`` (N,) or (N, k) at ``time`` (N,) s over each window: (M,) or (M, k)."""
        step = (time[-1] - time[0]) / (len(time) - 1)
        sums = Accumulated(float(time[0]), float(step), samples).between(self.start, self.end)
        width = self.end - self.start
        return np.asarray(sums / width.reshape(-1, *([1] * (samples.ndim - 1))))

    def inside(self, time: Float) -> NDArray[np.bool_]:
        """Which (M,) lie within ``time`` (N,) s."""
        return np.asarray((self.start >= time[0]) & (self.end <= time[-1]))

    def part(self, which: NDArray[np.bool_]) -> Windows:
        """Some of them."""
        return Windows(self.start[which], self.end[which])


@dataclass(frozen=True)
class Meter:
    """Means over ``window`` s, there ``late`` s after its end; how well each is known: one standard deviation."""

    window: float
    late: float
    window_spread: float = 0.0
    late_spread: float = 0.0

    def windows(self, readings: Readings) -> Windows:
        """What each of them stands for."""
        end = readings.time - self.late
        return Windows(end - self.window, end)

    @property
    def told(self) -> str:
        """In words, with 95 % intervals: ``means over 100 ± 4 ms, 152 ± 2 ms late``."""
        return f"means over {_ms(self.window, self.window_spread)}, {_ms(self.late, self.late_spread)} late"


def _ms(value: float, spread: float) -> str:
    bound = 2e3 * spread
    return f"{1e3 * value:.0f} ms" if bound < 0.5 else f"{1e3 * value:.0f} ± {bound:.0f} ms"
