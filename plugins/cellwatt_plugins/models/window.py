"""Window of a model at each frame: the frame itself, or the last few."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.onnx_file import Array


def whole(values: Array, optional: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) true for frames (n, inputs) with all required values.

    An ``optional`` input (inputs,) may be NaN; a frame with an infinite value is never complete.
    """
    there = np.isfinite(values)
    if optional.any():
        there |= optional & np.isnan(values)
    return np.asarray(there.all(axis=-1))


class Window:
    """The last ``size`` frames of some inputs at each frame, complete windows only.

    A window is incomplete if a ``needed`` input (inputs,) is missing in it, if it crosses a gap in the grid, or if it
    begins before the first frame. Frames may be split into blocks anywhere. ``step`` is that of the grid, ns.
    """

    def __init__(self, size: int, needed: NDArray[np.bool_], step: int) -> None:
        self._size = size
        self._optional = ~needed
        self._hole = step + step // 2
        self._offsets = np.arange(1 - size, 1)
        self._time = np.zeros(size - 1, dtype=np.int64)
        self._values: Array = np.full((size - 1, len(needed)), np.nan)

    def update(self, time: NDArray[np.int64], values: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the indices of those of the next n frames, values (n, inputs), with a complete window, and the
        windows.

        Windows are (k, size, inputs), the newest frame last, or (k, inputs) if the size is 1.
        """
        if self._size == 1:
            rows = np.flatnonzero(whole(values, self._optional))
            return rows, (values if len(rows) == len(values) else values[rows])
        past = self._size - 1
        time = np.concatenate([self._time, time])
        values = np.concatenate([self._values, values], dtype=values.dtype)
        self._time, self._values = time[-past:], values[-past:]
        ends = past + np.flatnonzero(self._lengths(time, values)[past:] >= self._size)
        return ends - past, values[ends[:, np.newaxis] + self._offsets]

    def _lengths(self, time: NDArray[np.int64], values: Array) -> NDArray[np.intp]:
        """Number of consecutive frames, without a gap or a missing value, that end at each frame."""
        at = np.arange(len(time))
        start = np.where(whole(values, self._optional), 0, at + 1)
        holes = 1 + np.flatnonzero(np.diff(time) > self._hole)
        start[holes] = np.maximum(start[holes], holes)
        return at + 1 - np.maximum.accumulate(start)
