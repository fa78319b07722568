"""Recordings as other loggers would have written them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import rows_of
from real.recording import Float, Recording


def _as_written(recording: Recording) -> Recording:
    return recording


def _late(recording: Recording) -> Recording:
    """Stamped by a busy PC, up to two fifths of a step late."""
    late = np.random.default_rng(1).uniform(0, 0.4, len(recording.time)) * np.median(np.diff(recording.time))
    return replace(recording, time=recording.time + late)


def _repeated(recording: Recording) -> Recording:
    """Logged at 1.6 of the controller's rate: rows are repeated until there is a new sample."""
    return _newest(recording, np.arange(*recording.time[[0, -1]], np.median(np.diff(recording.time)) / 1.6))


def _loop(recording: Recording) -> Recording:
    """Logged by a loop with pauses that takes the newest sample, at some 0.8 of the controller's rate."""
    step = 1.21 * float(np.median(np.diff(recording.time)))
    first, last = recording.time[[0, -1]]
    time = first + np.cumsum(step + np.random.default_rng(2).exponential(0.03 * step, int((last - first) / step)))
    return _newest(recording, time[time < last])


def _newest(recording: Recording, time: Float) -> Recording:
    """The newest sample at each ``time`` (M,) s."""
    rows: NDArray[np.intp] = np.searchsorted(recording.time, time + 1e-9, side="right") - 1
    return replace(rows_of(recording, rows), time=time)


LOGGERS: Mapping[str, Callable[[Recording], Recording]] = {
    "source": _as_written,
    "late": _late,
    "repeated": _repeated,
    "loop": _loop,
}
"""The recording as its source wrote it, and as others would have."""
