"""The rows that a run is fitted by: every so many samples, or what a meter shows of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.sparse import csr_array

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.meter.model import Windows
from cellwatt_plugins.robot.motion import smooth
from cellwatt_plugins.robot.samples import interpolated
from cellwatt_plugins.robot.servo.filtered import compared

ROWS = 16000
"""Rows that are fitted, about."""
LEAST_RATE = 12.0
"""Hz that are fitted at least."""
ROWS_PERIOD = 3.0
"""Rows that are fitted in a period of the fastest that is compared."""


@dataclass(frozen=True)
class Thinned:
    """Every so many of ``count`` samples."""

    count: int
    every: int
    sample_step: float

    @property
    def step(self) -> float:
        """Seconds from row to row."""
        return self.sample_step * self.every

    def of(self, samples: Float) -> Float:
        """Samples (N, …) as rows (M, …)."""
        return samples[:: self.every]

    def variance(self, samples: Float) -> Float:
        """Variances (N, C) as rows (M, C)."""
        return samples[:: self.every]

    def samples(self, rows: Float) -> Float:
        """Rows (M, C) as samples (N, C), interpolated between them."""
        places = np.arange(self.count) / self.every
        before = places.astype(np.intp)
        share = (places - before)[:, None]
        return np.asarray((1 - share) * rows[before] + share * rows[np.minimum(before + 1, len(rows) - 1)])

    def span(self, rows: slice) -> slice:
        """The samples that some rows stand for."""
        return slice(rows.start * self.every, rows.stop * self.every)


@dataclass(frozen=True)
class Filtered(Thinned):
    """Every so many of ``count`` samples, each without what is above ``bandwidth`` Hz."""

    bandwidth: float = 0.0

    def of(self, samples: Float) -> Float:
        """Samples (N, …) as rows (M, …)."""
        flat = smooth(samples.reshape(self.count, -1), self.sample_step, self.bandwidth)
        return np.ascontiguousarray(flat[:: self.every].reshape(-1, *samples.shape[1:]))

    def variance(self, samples: Float) -> Float:
        """Variances (N, C) of what is slower than the bandwidth, as rows (M, C)."""
        width = max(1, round(0.5 / (self.bandwidth * self.sample_step)))
        return np.asarray(uniform_filter1d(samples, width, axis=0)[:: self.every])


@dataclass(frozen=True)
class Metered:
    """The mean of the samples at ``time`` (N,) s over what each value of a meter stands for."""

    time: Float
    windows: Windows
    step: float

    @cached_property
    def _weights(self) -> csr_array:
        # Every effect that is tried goes through them.
        return self.windows.weights(self.time)

    def of(self, samples: Float) -> Float:
        """Samples (N, …) as rows (M, …)."""
        return np.asarray(self._weights @ samples)

    def samples(self, rows: Float) -> Float:
        """Rows (M, C) as samples (N, C), interpolated between them."""
        return interpolated(self.time, self.windows.middle, rows)

    def span(self, rows: slice) -> slice:
        """The samples that some rows stand for."""
        first, last = self.windows.start[rows.start], self.windows.end[rows.stop - 1]
        begin, end = np.searchsorted(self.time, [first, last]).tolist()
        return slice(begin, max(end, begin + 1))


Rows = Thinned | Metered
"""M rows made of the N samples of a run."""


def thinned(runs: Sequence[Run]) -> tuple[Thinned, ...]:
    """Every so many samples, so that about ``ROWS`` are fitted, at ``LEAST_RATE`` or more."""
    most = sum(len(run.time) for run in runs) / ROWS
    every = max(1, min(round(most), int(1 / (runs[0].step * LEAST_RATE))))
    return tuple(Thinned(len(run.time), every, run.step) for run in runs)


def filtered(runs: Sequence[Run]) -> tuple[Filtered, ...]:
    """What is slow enough to be compared of runs whose torque is that of their servos' law."""
    out = []
    for run in runs:
        bandwidth = compared(run.step)
        every = max(1, int(1 / (ROWS_PERIOD * bandwidth * run.step)))
        out.append(Filtered(len(run.time), every, run.step, bandwidth))
    return tuple(out)
