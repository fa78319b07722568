"""Delay of one motion behind another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

SAME = 0.25
"""Difference up to which two motions are the same; see ``delay``."""
LATE = 0.3
"""s; no controller follows its plan with a longer delay."""
LEAST_SHARED = 0.5
"""Share of the shorter motion that must overlap."""
TIE = 0.02
"""Shifts whose difference exceeds the least one by no more are equivalent; the smallest is taken, as cycles repeat."""


def delay(later: Float, earlier: Float) -> tuple[float, float]:
    """Samples by which positions ``later`` (N, n) follow ``earlier`` (M, n), and their difference after that shift.

    Both are on grids of the same step. The difference is the rms, each joint about its mean and in units of its own
    motion: 0 for the same motion, 1.4 for another one.
    """
    a, b = _scaled(later), _scaled(earlier)
    shift = _coarse(a, b)
    error = _difference(a, b, shift)
    while (near := min((_difference(a, b, s), s) for s in (shift - 1, shift + 1)))[0] < error:
        error, shift = near
    before, after = _difference(a, b, shift - 1), _difference(a, b, shift + 1)
    bend = before**2 - 2 * error**2 + after**2
    part = 0.5 * (before**2 - after**2) / bend if 0 < bend < np.inf else 0.0
    return shift + part, error


def _coarse(a: Float, b: Float) -> int:
    """The best whole shift, found by one FFT for all shifts; means are of the whole motions, not of their overlap."""
    least = max(1, int(LEAST_SHARED * min(len(a), len(b))))
    shifts = np.arange(least - len(b), len(a) - least + 1)
    size = 1 << (len(a) + len(b) - 1).bit_length()
    products = np.fft.irfft(np.sum(np.fft.rfft(a, size, axis=0) * np.fft.rfft(b, size, axis=0).conj(), axis=1), size)
    first, last = np.maximum(shifts, 0), np.minimum(len(b) + shifts, len(a))
    squares = _sums(a, first, last) + _sums(b, first - shifts, last - shifts) - 2 * products[shifts]
    errors = np.sqrt(np.maximum(squares, 0) / (last - first) / _moving(b))
    good = np.flatnonzero(errors <= errors.min() + TIE)
    valleys = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
    nearest = valleys[int(np.argmin([np.abs(shifts[valley]).min() for valley in valleys]))]
    return int(shifts[nearest[np.argmin(errors[nearest])]])


def _difference(a: Float, b: Float, shift: int) -> float:
    """The difference at one shift; infinite if too little overlaps."""
    first, last = max(shift, 0), min(len(b) + shift, len(a))
    if last - first < LEAST_SHARED * min(len(a), len(b)):
        return float("inf")
    difference = a[first:last] - b[first - shift : last - shift]
    return float(np.sqrt(np.sum(np.var(difference, axis=0)) / _moving(b)))


def _moving(scaled: Float) -> int:
    return max(1, int(scaled.any(axis=0).sum()))


def _scaled(position: Float) -> Float:
    """Positions about their mean, in units of each joint's own motion; 0 for joints at rest."""
    centred = position - position.mean(axis=0)
    scale = np.std(position, axis=0)
    moves = scale > 1e-2 * scale.max()
    return np.asarray(np.divide(centred, scale, out=np.zeros_like(centred), where=moves), np.float64)


def _sums(values: Float, first: NDArray[np.int_], last: NDArray[np.int_]) -> Float:
    total = np.concatenate([[0.0], np.cumsum(np.sum(values**2, axis=1))])
    return np.asarray(total[last] - total[first], np.float64)
