"""A first-order thermal state, driven by a loss."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float


def warmth(loss: Float, step: float, time_constant: float) -> Float:
    """Temperature rise (N, ...) in units of the loss, from cold: dx/dt = (loss - x) / time constant."""
    keep = float(np.exp(-step / time_constant))
    from scipy.signal import lfilter  # with scipy.stats behind it a second to load

    return np.asarray(lfilter([0.0, 1 - keep], [1.0, -keep], loss, axis=0), np.float64)
