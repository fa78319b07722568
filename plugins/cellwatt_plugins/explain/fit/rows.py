"""The rows to which a run is fitted: every k-th sample, or the values of a meter."""

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
from cellwatt_plugins.robot.servo.filtered import compared_band

ROWS = 16000
"""Approximate number of fitted rows."""
LEAST_RATE = 12.0
"""Smallest rate of fitted rows, Hz."""
ROWS_PERIOD = 3.0
"""Fitted rows per period of the highest compared frequency."""


@dataclass(frozen=True)
class Thinned:
    """Every ``every``-th of ``count`` samples."""

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
        samples = np.arange(self.count, dtype=np.float64)
        return interpolated(samples, samples[:: self.every], rows)

    def span(self, rows: slice) -> slice:
        """The samples covered by a slice of rows."""
        return slice(rows.start * self.every, rows.stop * self.every)


@dataclass(frozen=True)
class Filtered(Thinned):
    """Every ``every``-th of ``count`` samples, low-pass filtered at ``bandwidth`` Hz."""

    bandwidth: float = 0.0

    def of(self, samples: Float) -> Float:
        """Samples (N, …) as rows (M, …)."""
        flat = smooth(samples.reshape(self.count, -1), self.sample_step, self.bandwidth)
        return np.ascontiguousarray(flat[:: self.every].reshape(-1, *samples.shape[1:]))

    def variance(self, samples: Float) -> Float:
        """Variances (N, C) of the part below the bandwidth, as rows (M, C)."""
        width = max(1, round(0.5 / (self.bandwidth * self.sample_step)))
        return np.asarray(uniform_filter1d(samples, width, axis=0)[:: self.every])


@dataclass(frozen=True)
class Metered:
    """Means of the samples at ``time`` (N,) s over the window of each meter value."""

    time: Float
    windows: Windows
    step: float

    @cached_property
    def _weights(self) -> csr_array:
        # The weights are applied to every effect that is tried.
        return self.windows.weights(self.time)

    def of(self, samples: Float) -> Float:
        """Samples (N, …) as rows (M, …)."""
        return np.asarray(self._weights @ samples)

    def samples(self, rows: Float) -> Float:
        """Rows (M, C) as samples (N, C), interpolated between them."""
        return interpolated(self.time, self.windows.middle, rows)

    def span(self, rows: slice) -> slice:
        """The samples covered by a slice of rows."""
        first, last = self.windows.start[rows.start], self.windows.end[rows.stop - 1]
        begin, end = np.searchsorted(self.time, [first, last]).tolist()
        return slice(begin, max(end, begin + 1))


Rows = Thinned | Metered
"""M rows made of the N samples of a run."""


def thinned(runs: Sequence[Run]) -> tuple[Thinned, ...]:
    """Thin the samples of runs to about ``ROWS`` rows in total, at ``LEAST_RATE`` or more."""
    most = sum(len(run.time) for run in runs) / ROWS
    every = max(1, min(round(most), int(1 / (runs[0].step * LEAST_RATE))))
    return tuple(Thinned(len(run.time), every, run.step) for run in runs)


def filtered(runs: Sequence[Run]) -> tuple[Filtered, ...]:
    """Low-pass filter and thin runs whose torque comes from their servos' law."""
    out = []
    for run in runs:
        bandwidth = compared_band(run.step)
        every = max(1, int(1 / (ROWS_PERIOD * bandwidth * run.step)))
        out.append(Filtered(len(run.time), every, run.step, bandwidth))
    return tuple(out)
