"""Patterns of the plant's healthy cycles, and patterns of bells."""

from __future__ import annotations

import numpy as np

from tests.plugins.faults.paper.irb1200 import Run, period, run


def pattern_of(moves, *, cycles: int = 20, speed: float = 1.0, noise: float = 1.0):
    """Times (n,) s and mean power (n,) W of a task's healthy cycles."""
    plan = Run(moves, cycles=cycles, speed=speed, seed=3, noise=noise)
    told, length = run(plan), int(period(moves, speed) * plan.rate)
    rows = [told.power[np.searchsorted(told.t, start - 1e-9) :][:length] for start in told.starts]
    return np.arange(length) / plan.rate, np.mean(rows, axis=0)


def bells(t, centres, heights, width: float):
    """Power (n,) W of peaks at ``centres`` (k,) s, the resonances' own shape, ``width`` s to either side."""
    return np.sum(heights / np.sqrt(1 + ((t[:, None] - np.asarray(centres)) / width) ** 2), axis=1)
