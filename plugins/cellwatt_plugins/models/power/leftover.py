"""A small network for each joint, of the torque residual of the physics; used only if it helps on held-out moves."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.perceptron import Perceptron
from cellwatt_plugins.models.power.terms import Motion

NEURONS: Final = 8
ITERATIONS: Final = 200
ROWS: Final = 6000
EVERY: Final = 7
"""One of so many blocks of rows decides when to stop."""
BLOCK: Final = 50
"""Number of rows in a block."""
LEAST: Final = 0.3
"""Smallest scale of an input, as a share of its standard deviation in the median joint."""


def inputs(motion: Motion) -> list[Any]:
    """Inputs of a joint's network: (N, n) each."""
    return [np.sin(motion.q), np.cos(motion.q), motion.qd, motion.qdd, motion.sign, motion.load]


def train(motion: Motion, residual: Float) -> Perceptron:
    """The joints' networks, ``stacked``, of the torque ``residual``, (N, n) Nm; rows without a value are skipped."""
    rows = np.flatnonzero(np.isfinite(residual).all(axis=1))
    rows = rows[:: max(1, len(rows) // ROWS)]
    held = np.arange(len(rows)) // BLOCK % EVERY == EVERY - 1
    seen = np.stack([each[rows] for each in inputs(motion)], axis=2)
    least = LEAST * np.median(seen.std(axis=0), axis=0)
    joints = range(residual.shape[1])
    return Perceptron.stacked(
        [Perceptron.train(seen[:, j], residual[rows, j, None], held, NEURONS, ITERATIONS, least) for j in joints]
    )
