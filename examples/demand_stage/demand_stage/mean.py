"""A mean over the last so many samples, however they are cut into blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


class MovingMean:
    """Mean over the last ``length`` samples that are not missing; NaN until ``length`` samples were seen."""

    def __init__(self, length: int) -> None:
        if length < 1:
            raise ValueError("a mean needs at least one sample")
        self._length = length
        self._kept: Float = np.empty(0)

    def update(self, values: Float) -> Float:
        """The mean (n,) at each of the next values (n,), where NaN is missing."""
        seen = np.concatenate([self._kept, values])
        known = np.isfinite(seen)
        # Sums from 0, so that sums over a window are differences.
        sums = np.concatenate([[0.0], np.cumsum(np.where(known, seen, 0.0))])
        counts = np.concatenate([[0], np.cumsum(known)])
        ends = np.arange(len(self._kept), len(seen)) + 1
        starts = np.maximum(ends - self._length, 0)
        count = counts[ends] - counts[starts]
        mean = np.full(len(values), np.nan)
        full = (ends >= self._length) & (count > 0)
        mean[full] = (sums[ends] - sums[starts])[full] / count[full]
        self._kept = seen[max(0, len(seen) - self._length) :]
        return mean
