"""What a slow meter makes of power: means over a window, late, each held until the next comes."""

from __future__ import annotations

import numpy as np


def measured(time: np.ndarray, power: np.ndarray, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Mean of ``power`` (N,) W at ``time`` (N,) s over each window (M,): (M,) W."""
    steps = np.diff(time) * (power[1:] + power[:-1]) / 2
    energy = np.concatenate([[0.0], np.cumsum(steps)])
    means = np.interp(ends, time, energy) - np.interp(begins, time, energy)
    return means / np.maximum(ends - begins, 1e-9)


def shown(
    time: np.ndarray,
    power: np.ndarray,
    window: float,
    late: float,
    *,
    interval: float | None = None,
    phase: float = 0.4,
) -> np.ndarray:
    """``power`` (N,) W at evenly spaced ``time`` (N,) s as such a meter's last value has it in each row."""
    interval = interval or window
    ends = np.arange(time[0] + phase * interval, time[-1], interval)
    means = measured(time, power, np.maximum(ends - window, time[0]), ends)
    which = np.searchsorted(ends + late, time, side="right") - 1
    return np.where(which >= 0, means[np.maximum(which, 0)], power[0])
