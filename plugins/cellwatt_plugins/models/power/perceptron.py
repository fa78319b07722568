"""A network of one hidden layer and direct connections, trained by Scaled Conjugate Gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.scg import minimise
from cellwatt_plugins.onnx_graph import beside

DECAY: Final = 1e-4
"""Penalty on the squares of the weights, relative to the mean square error of standardised outputs."""
SEED: Final = 0
"""Seed of the first weights."""
PATIENCE: Final = 50
"""Number of steps without a lower error on the held-out rows after which training ends."""


@dataclass(frozen=True)
class Perceptron:
    """Outputs from inputs through one layer of tanh, and through direct connections; both are scaled inside."""

    mean: Float
    scale: Float
    """(inputs,)."""
    hidden: Float
    """(inputs + 1, neurons); the last row is the bias."""
    direct: Float
    """(inputs + 1, outputs) in the outputs' units; the last row is the bias."""
    out: Float
    """(neurons, outputs), in the outputs' units."""

    def __call__(self, x: Any) -> Any:
        """(N, outputs) for (N, inputs), an array or a tensor of a graph."""
        scaled = (x - self.mean) * (1 / self.scale)
        inside = np.tanh(scaled @ self.hidden[..., :-1, :] + self.hidden[..., -1:, :])
        return inside @ self.out + (scaled @ self.direct[..., :-1, :] + self.direct[..., -1:, :])

    @classmethod
    def stacked(cls, networks: Sequence[Perceptron]) -> Perceptron:
        """The networks of n joints as one, for ``by_joint``."""
        every = zip(*((own.mean, own.scale, own.hidden, own.direct, own.out) for own in networks), strict=True)
        mean, scale, *weights = map(np.stack, every)
        return cls(mean[:, None], scale[:, None], *weights)

    def by_joint(self, columns: Sequence[Any]) -> Any:
        """Outputs (N, n) of ``stacked`` networks for the columns (N, n) of their inputs, arrays or tensors."""
        joints = len(self.hidden)
        x = beside([each.reshape(-1, joints, 1) for each in columns])
        return self(x.transpose(1, 0, 2)).transpose(1, 0, 2).reshape(-1, joints)

    @classmethod
    def train(
        cls, x: Float, y: Float, held: NDArray[np.bool_], neurons: int, iterations: int, least: Float
    ) -> Perceptron:
        """Weights with the lowest error on the rows ``held`` (N,) out, of all steps of the training on the other rows.

        Inputs are divided by their standard deviation, or by ``least`` (inputs,) if that is larger.
        """
        mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), np.maximum(least, 1e-9))
        level, size = y.mean(axis=0), np.maximum(y.std(axis=0), 1e-9)
        a, b = (x - mean) / scale, (y - level) / size
        shape = _Shape(x.shape[1], neurons, y.shape[1])
        draw = np.random.default_rng(SEED)
        best, least_error, at = draw.normal(size=shape.weights) / np.sqrt(x.shape[1]), np.inf, 0
        judged = held if held.any() else ~held

        def watch(step: int, w: Float) -> bool:
            nonlocal best, least_error, at
            error = float(np.mean((shape.forward(w, a[judged])[1] - b[judged]) ** 2))
            if error < least_error:
                best, least_error, at = w, error, step
            return step - at > PATIENCE

        minimise(lambda w: shape.loss(w, a[~held], b[~held]), best, iterations, 1e-6, watch)
        hidden, direct, out = shape.split(best)
        return cls(mean, scale, hidden, np.concatenate([direct[:-1] * size, direct[-1:] * size + level]), out * size)


@dataclass(frozen=True)
class _Shape:
    """Numbers of inputs, neurons and outputs; all weights are one vector."""

    inputs: int
    neurons: int
    outputs: int

    @property
    def weights(self) -> int:
        return (self.inputs + 1) * (self.neurons + self.outputs) + self.neurons * self.outputs

    def split(self, w: Float) -> tuple[Float, Float, Float]:
        """Hidden, direct and output weights; the first two with the bias as last row."""
        first = (self.inputs + 1) * self.neurons
        second = first + (self.inputs + 1) * self.outputs
        return (
            w[:first].reshape(-1, self.neurons),
            w[first:second].reshape(-1, self.outputs),
            w[second:].reshape(-1, self.outputs),
        )

    def forward(self, w: Float, x: Float) -> tuple[Float, Float]:
        """Outputs of the hidden layer and of the network."""
        hidden, direct, out = self.split(w)
        inside = np.tanh(x @ hidden[:-1] + hidden[-1])
        return inside, inside @ out + x @ direct[:-1] + direct[-1]

    def loss(self, w: Float, x: Float, y: Float) -> tuple[float, Float]:
        """Half the mean square error with the penalty on all weights but the direct ones, and its gradient."""
        inside, given = self.forward(w, x)
        residual = given - y
        by_out = residual / residual.size
        back = (by_out @ self.split(w)[2].T) * (1 - inside**2)
        gradient = np.concatenate(
            [
                np.concatenate([x.T @ back, back.sum(axis=0)[None]]).ravel(),
                np.concatenate([x.T @ by_out, by_out.sum(axis=0)[None]]).ravel(),
                (inside.T @ by_out).ravel(),
            ]
        )
        penalised = w.copy()
        self.split(penalised)[1][:] = 0.0
        return float(0.5 * np.mean(residual**2) + 0.5 * DECAY * (penalised @ penalised)), gradient + DECAY * penalised
