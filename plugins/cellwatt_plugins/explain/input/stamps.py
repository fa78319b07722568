"""Times at which rows were sampled: a logger may stamp unevenly what a controller sampled evenly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.signal import savgol_filter

from cellwatt.arrays import Float

HOLE = 4.5
"""Step, in median steps, across which positions are not compared: the motion in between is unknown."""
FARTHEST = 4.0
"""Largest distance, in steps, of a stamp from the even time that replaces it."""
SMOOTHED = 9
"""Rows over which a velocity is fitted, so that it does not follow the noise of a row."""
SURE = 5.0
"""Standard errors between what the positions show and the middle of both answers."""


def sampled(time: Float, positions: Sequence[Float]) -> Float:
    """Even times (N,) s in place of the stamps ``time`` (N,) s, if ``positions``, each (N,), show them.

    Missing rows stay missing. Without even times that positions show, ``time`` itself.
    """
    if len(time) < SMOOTHED or not positions:
        return time
    near = np.convolve(np.diff(time) < HOLE * np.median(np.diff(time)), np.ones(4), "valid") > 3.5
    best, least = time, np.inf
    for even, step in _even(time):
        off = [_deviation(even, values)[near] for values in positions]
        if np.abs(even - time).max() < FARTHEST * step and (rough := float(np.sum(np.square(off)))) < least:
            moved = _deviation(even, time - even)
            slopes = [savgol_filter(values, SMOOTHED, 2, deriv=1, delta=step)[2:-2] for values in positions]
            best = even if _shows(off, [(slope * moved)[near] for slope in slopes]) else time
            least = rough
    return best


def _even(time: Float) -> Iterator[tuple[Float, float]]:
    """Candidates (N,) s and their step, s: rows numbered one by one, and by their stamps to the nearest step."""
    steps = np.diff(time)
    numbers = np.maximum(np.round(steps / np.median(steps)), 1.0)
    for counted in (np.ones(len(steps)), numbers):
        number = np.concatenate([[0.0], np.cumsum(counted)])
        step, start = np.polyfit(number, time, 1)
        yield start + step * number, float(step)


def _deviation(time: Float, values: Float) -> Float:
    """Deviation (N - 4,) of values (N,) at ``time`` (N,) s from the cubic through the two rows on either side."""
    rows = (0, 1, 3, 4)
    offsets = [time[k : len(time) - 4 + k] - time[2:-2] for k in rows]
    out = values[2:-2].copy()
    for k, own in zip(rows, offsets, strict=True):
        others = [other / (other - own) for other in offsets if other is not own]
        out -= np.prod(others, axis=0) * values[k : len(values) - 4 + k]
    return out


def _shows(off: Sequence[Float], stamped: Sequence[Float]) -> bool:
    """True if the deviations ``off`` at even times are not those, ``stamped``, of rows sampled at their stamps."""
    seen, expected = np.concatenate(off), np.concatenate(stamped)
    if not (size := float(expected @ expected)):
        return False
    share = float(seen @ expected) / size
    error = float(np.sqrt(np.mean(np.square(seen - share * expected)) / size))
    return share + SURE * error < 0.5
