"""Estimates of the noise of a signal."""

from __future__ import annotations

from math import comb

import numpy as np

from cellwatt.arrays import Float

LEVELS = 0.2
"""Largest number of different values of a channel that comes in steps, as a share of its samples."""


def white_noise(values: Float, order: int = 3) -> Float:
    """Return the standard deviation (c,) of white noise in evenly sampled ``values`` (N, c) or (N,).

    From the median of their differences of this ``order``, in which motion cancels; NaN for columns without values.
    """
    size = np.abs(np.diff(values if values.ndim > 1 else values[:, None], order, axis=0))
    known = (column[np.isfinite(column)] for column in size.T)
    middle = np.array([np.median(column) if len(column) else np.nan for column in known])
    return np.asarray(middle / 0.6745 / np.sqrt(comb(2 * order, order)))


def step_noise(measured: Float) -> Float:
    """Return the noise (c,) of channels (N, c) that come in steps; 0 for channels without steps."""
    out = np.zeros(measured.shape[1])
    for channel, values in enumerate(measured.T):
        known = values[np.isfinite(values)]
        levels = np.unique(known)
        if 1 < len(levels) < LEVELS * len(known):
            out[channel] = float(np.min(np.diff(levels))) / np.sqrt(12.0)
    return out
