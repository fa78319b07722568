"""Integrals of sampled signals between any two times."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float


class Accumulated:
    """Running integral of evenly spaced samples (N,) or (N, k), each held for half a step on either side."""

    def __init__(self, first: float, step: float, samples: Float) -> None:
        self.start = first - step / 2
        self.end = self.start + step * len(samples)
        self._step = step
        self._sums = np.concatenate([np.zeros((1, *samples.shape[1:])), np.cumsum(samples, axis=0) * step])

    def until(self, time: Float) -> Float:
        """Integral from the first sample to ``time`` (M,) s: (M,) or (M, k), in the samples' unit times s.

        The first and the last sample are held beyond the recording, which begins and ends at rest.
        """
        position = (time - self.start) / self._step
        low = np.clip(np.floor(position), 0, len(self._sums) - 2).astype(np.int64)
        share = (position - low).reshape(-1, *([1] * (self._sums.ndim - 1)))
        return np.asarray(self._sums[low] + share * (self._sums[low + 1] - self._sums[low]))

    def between(self, start: Float, end: Float) -> Float:
        """Integrals (M,) or (M, k) from each ``start`` to its ``end``, (M,) s each."""
        return self.until(end) - self.until(start)
