"""Rests of an arm, by its encoders alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.recordings import Motion

Float = NDArray[np.float64]

STILL: Final = 0.1
"""s in which an arm at rest does not leave the noise."""
NOISY: Final = 8.0
"""So many standard deviations of the encoders are noise."""


def encoder_noise(position: Float) -> float:
    """Noise of the encoders (one standard deviation, rad) from third differences, in which slow motion cancels."""
    third = np.diff(position, n=3, axis=0)
    scale = np.median(np.abs(third), axis=0) / (0.6745 * np.sqrt(20.0))
    return max(float(np.median(scale)), 1e-7)


def rests(motion: Motion, creep: float = 0.0) -> list[tuple[int, int]]:
    """First and last sample (exclusive) of each rest: no joint moves beyond noise, or ``creep`` rad, in ``STILL``."""
    lag = max(1, round(STILL / motion.step))
    moved = np.abs(motion.position[lag:] - motion.position[:-lag]).max(axis=1)
    return [(a, b + lag) for a, b in spans(moved < max(creep, NOISY * encoder_noise(motion.position)))]


def spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last (exclusive) of each row of true ones among ``flags`` (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
