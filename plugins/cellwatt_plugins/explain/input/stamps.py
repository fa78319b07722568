"""Times at which rows were sampled: a logger may stamp rows late that a controller sampled evenly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cellwatt.arrays import Float

SMOOTHER = 0.5
"""Share of the roughness of the positions at the stamped times, below which other times are the sampled ones."""
HOLE = 4.5
"""Step, in median steps, across which positions are not compared: the motion in between is unknown."""
LATEST = 4.0
"""Largest distance, in steps, of a stamp from the even time that is taken for the sampled one."""


def sampled(time: Float, positions: Sequence[Float]) -> Float:
    """Even times (N,) s in place of the stamps ``time`` (N,) s, if ``positions``, each (N,), are far smoother at them.

    Rows that are missing stay missing. Otherwise ``time`` itself.
    """
    if len(time) < 5 or not positions:
        return time
    near = np.convolve(np.diff(time) < HOLE * np.median(np.diff(time)), np.ones(4), "valid") > 3.5
    if not near.any():
        return time
    stamped, best = _roughness(time, positions)[near].mean(), time
    least = SMOOTHER * stamped
    for even in _even(time):
        if np.abs(even - time).max() < LATEST * (even[-1] - even[0]) / (len(time) - 1):
            found = _roughness(even, positions)[near].mean()
            if found < least:
                least, best = found, even
    return best


def _even(time: Float) -> Iterator[Float]:
    """Candidates (N,) s: rows numbered one by one, and by their stamps to the nearest step."""
    steps = np.diff(time)
    numbers = np.maximum(np.round(steps / np.median(steps)), 1.0)
    for counted in (np.ones(len(steps)), numbers):
        number = np.concatenate([[0.0], np.cumsum(counted)])
        slope, start = np.polyfit(number, time, 1)
        yield start + slope * number


def _roughness(time: Float, positions: Sequence[Float]) -> Float:
    """Mean square (N - 4,) of each position's deviation from the cubic through the two rows on either side."""
    offsets = [time[k : len(time) - 4 + k] - time[2:-2] for k in (0, 1, 3, 4)]
    weights = [
        np.prod([other / (other - own) for i, other in enumerate(offsets) if i != k], axis=0)
        for k, own in enumerate(offsets)
    ]
    out = np.zeros(len(time) - 4)
    for values in positions:
        rows = [values[k : len(values) - 4 + k] for k in (0, 1, 3, 4)]
        out += np.square(sum(weight * row for weight, row in zip(weights, rows, strict=True)) - values[2:-2])
    return out / len(positions)
