"""How well a fault can be told from healthy power at all, by the end of the move in which it first acts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from concealed.arms import Array
from scipy.optimize import lsq_linear
from scipy.special import ndtr, ndtri

from faults.tasks import Path

ACCEPTED = 1e-4
"""Accepted share of healthy intervals with a false alarm."""
LEVEL = 2.0
"""W by which a supply's standing power may differ from cycle to cycle (one sigma)."""
THRESHOLD = -float(ndtri(ACCEPTED))
"""Standard deviations of the meter's noise that noise alone exceeds in that share."""


def signal_to_noise(path: Path, move: int, effect: Array, harmless: Sequence[Array], noise: float) -> float:
    """Matched filter's signal-to-noise ratio of a fault from the cycle's start to the end of ``move`` (from 1).

    ``effect`` (N,) W is what the fault does to power, ``harmless`` (N,) W each what the largest harmless changes do,
    ``noise`` W of each sample. The fault's shape and size, healthy power and the shape of each harmless change are
    taken as known; not whether the change is there, nor how large. So what counts is how far the fault is from the
    healthy cycle most like it (Kay, Fundamentals of Statistical Signal Processing II, ch. 4 and 6).
    """
    seen = np.flatnonzero(path.move == move - 1)
    rows = slice(0, int(seen[-1]) + 1)
    changes = np.column_stack(harmless)[rows] / noise
    nearest = lsq_linear(changes, effect[rows] / noise, bounds=(-1.0, 1.0))
    return float(np.sqrt(2.0 * nearest.cost))


def signal_to_spread(path: Path, move: int, effect: Array, harmless: Sequence[Array], noise: float) -> float:
    """The same where harmless changes have no bound but a normal spread, ``harmless`` (N,) W one sigma of each, and the
    supply's level may differ from cycle to cycle: √(dᵀ Σ⁻¹ d) of the effect d and the spread's covariance Σ."""
    seen = np.flatnonzero(path.move == move - 1)
    rows = slice(0, int(seen[-1]) + 1)
    shape = effect[rows] / noise
    changes = np.column_stack([*harmless, np.full(len(effect), LEVEL)])[rows] / noise
    left = np.linalg.solve(np.eye(changes.shape[1]) + changes.T @ changes, changes.T @ shape)
    return float(np.sqrt(max(0.0, float(shape @ (shape - changes @ left)))))


def told_at_best(signal_to_noise_: float) -> float:
    """Probability that the best detector tells it, at ``ACCEPTED`` false alarms (Neyman and Pearson)."""
    return float(ndtr(signal_to_noise_ - THRESHOLD))
