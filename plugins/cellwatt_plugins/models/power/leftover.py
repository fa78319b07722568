"""A small network for each joint, of the torque residual of the physics; used only if it helps on held-out moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.perceptron import Perceptron
from cellwatt_plugins.models.power.terms import Motion
from cellwatt_plugins.onnx_graph import beside

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


@dataclass(frozen=True)
class Leftover:
    """The networks of all n joints as one, with blocks of weights; inputs in the order of ``inputs``."""

    hidden: Float
    """(6 n, n · neurons)."""
    bias: Float
    direct: Float
    """(6 n, n)."""
    out: Float
    """(n · neurons, n)."""
    level: Float
    """(n,) Nm."""

    def __call__(self, motion: Motion) -> Any:
        """Torque (N, n) Nm of a motion."""
        x = beside(inputs(motion))
        return np.tanh(x @ self.hidden + self.bias) @ self.out + (x @ self.direct + self.level)

    @classmethod
    def train(cls, motion: Motion, residual: Float, seed: int) -> Leftover:
        """Train on the torque ``residual``, (N, n) Nm; rows without a value are skipped."""
        rows = np.flatnonzero(np.isfinite(residual).all(axis=1))
        rows = rows[:: max(1, len(rows) // ROWS)]
        held = np.arange(len(rows)) // BLOCK % EVERY == EVERY - 1
        seen = np.stack([each[rows] for each in inputs(motion)], axis=2)
        least = LEAST * np.median(seen.std(axis=0), axis=0)
        networks = [
            Perceptron.train(seen[:, j], residual[rows, j, None], held, NEURONS, ITERATIONS, seed, least)
            for j in range(residual.shape[1])
        ]
        return cls.of(networks)

    @classmethod
    def of(cls, networks: list[Perceptron]) -> Leftover:
        """Combine the joints' networks into one; their scaling is merged into the weights."""
        n, each = len(networks), len(networks[0].mean)
        hidden, bias = np.zeros((each, n, n, NEURONS)), np.zeros((n, NEURONS))
        direct, out, level = np.zeros((each, n, n)), np.zeros((n, NEURONS, n)), np.zeros(n)
        for j, network in enumerate(networks):
            first, straight = network.hidden[:-1] / network.scale[:, None], network.direct[:-1] / network.scale[:, None]
            hidden[:, j, j], direct[:, j, j], out[j, :, j] = first, straight[:, 0], network.out[:, 0]
            bias[j] = network.hidden[-1] - network.mean @ first
            level[j] = network.direct[-1, 0] - network.mean @ straight[:, 0]
        size = n * NEURONS
        return cls(hidden.reshape(-1, size), bias.reshape(-1), direct.reshape(-1, n), out.reshape(size, n), level)
