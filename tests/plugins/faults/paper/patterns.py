"""Patterns of the plant's healthy cycles."""

from __future__ import annotations

import numpy as np

from tests.plugins.faults.paper.irb1200 import Run, period, run


def pattern_of(moves, *, cycles: int = 20, speed: float = 1.0, seed: int = 3, rate: float = 123.0):
    """Times (n,) s and mean power (n,) W of a task's healthy cycles."""
    told = run(Run(moves, cycles=cycles, speed=speed, seed=seed, rate=rate))
    length = int(period(moves, speed) * rate)
    rows = [told.power[np.searchsorted(told.t, start - 1e-9) :][:length] for start in told.starts]
    return np.arange(length) / rate, np.mean(rows, axis=0)
