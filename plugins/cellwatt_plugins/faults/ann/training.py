"""Trains the network on injected cycles, and sets its limits on others that it has not seen.

Its first layer is no learnt one: it takes off what healthy cycles have in common (their mean and covariance), so that
what reaches the neurons are standard deviations of harmless change, compressed by asinh.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt.progress import stage
from cellwatt_plugins.faults.ann.bins import Bins
from cellwatt_plugins.faults.ann.inject import Injected, Injector
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.pattern import Pattern

Float = NDArray[np.float64]

CYCLES, HELD, CALM = 16_000, 4_000, 6_000
"""Cycles to learn from, others to set limits on, and healthy ones to count false alarms in."""
HIDDEN = (96,)
PASSES = 24
RATE, DECAY, BATCH = 2e-3, 1e-4, 256
OFF = 0.007
"""rad that stands for one in the inputs of encoders."""
FALSE_ALARMS = 0.002
"""Share of healthy cycles in which an alarm is accepted."""
TEMPERATURES = np.geomspace(0.5, 4.0, 31)


@dataclass(frozen=True)
class Trained:
    """Layers of a network: the first takes off healthy change, the others are learnt; ``temperature`` divides what
    reaches the outputs, ``limit`` is the probability of a fault of power from which one is told, ``score`` the loss on
    held cycles."""

    mean: Float
    white: Float
    layers: list[tuple[Float, Float]]
    temperature: float
    limit: float
    loss: float

    def probabilities(self, inputs: Float) -> Float:
        """(N, 2 n + 1) for inputs (N, inputs): joints, encoders, any joint."""
        x = np.arcsinh((inputs - self.mean) @ self.white)
        for weights, bias in self.layers[:-1]:
            x = np.tanh(x @ weights + bias)
        weights, bias = self.layers[-1]
        return np.asarray(1 / (1 + np.exp(-np.clip(x @ weights + bias, -40, 40) / self.temperature)))


def train(arm: FittedArm, pattern: Pattern, seed: int = 0) -> Trained:
    """A network for one task at one speed. Raises ``ConfigError`` where scikit-learn is missing."""
    learn, held = Injector(arm, pattern, seed), Injector(arm, pattern, seed + 1)
    with stage("simulating cycles"):
        calm = learn.draw(CALM, healthy=1.0)
        mean, white = whitening(calm.inputs, learn.bins)
        drawn = learn.draw(CYCLES)
    with stage("training"):
        layers = _fitted(np.arcsinh((drawn.inputs - mean) @ white), drawn.labels, seed)
    raw = Trained(mean, white, layers, 1.0, 0.5, 0.0)
    temperature, loss = _temperature(raw, held.draw(HELD))
    tempered = Trained(mean, white, layers, temperature, 0.5, loss)
    any_joint = tempered.probabilities(held.draw(CALM, healthy=1.0).inputs)[:, -1]
    limit = max(0.5, float(np.quantile(any_joint, 1 - FALSE_ALARMS)))
    return Trained(mean, white, layers, temperature, limit, loss)


def whitening(calm: Float, bins: Bins) -> tuple[Float, Float]:
    """Mean (inputs,) and matrix (inputs, inputs) after which healthy residuals and paces are alike and independent."""
    count = bins.power + bins.moves
    mean = np.zeros(calm.shape[1])
    mean[:count] = calm[:, :count].mean(axis=0)
    white = np.eye(calm.shape[1]) / OFF
    values, vectors = np.linalg.eigh(np.cov(calm[:, :count].T))
    values = np.maximum(values, 1e-9 * values.max())
    white[:count, :count] = (vectors / np.sqrt(values)) @ vectors.T
    return mean, white


def _fitted(inputs: Float, labels: Float, seed: int) -> list[tuple[Float, Float]]:
    try:
        from sklearn.exceptions import ConvergenceWarning  # type: ignore[import-untyped]
        from sklearn.neural_network import MLPClassifier  # type: ignore[import-untyped]
    except ImportError as error:
        raise ConfigError(f"training needs scikit-learn ({error}): pip install 'cellwatt[train]'") from error
    network = MLPClassifier(
        HIDDEN,
        activation="tanh",
        alpha=DECAY,
        batch_size=BATCH,
        learning_rate_init=RATE,
        max_iter=PASSES,
        random_state=seed,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # how well it learnt is measured on cycles held out
        network.fit(inputs.astype(np.float32), labels.astype(np.int64))
    return [
        (np.asarray(w, np.float64), np.asarray(b, np.float64))
        for w, b in zip(network.coefs_, network.intercepts_, strict=True)
    ]


def _temperature(trained: Trained, held: Injected) -> tuple[float, float]:
    """The temperature at which held cycles are likeliest, and their mean log loss."""
    p = np.clip(trained.probabilities(held.inputs), 1e-9, 1 - 1e-9)
    logit, labels = np.log(p / (1 - p)), held.labels
    losses = [float(np.mean(np.logaddexp(0.0, -(2 * labels - 1) * logit / t))) for t in TEMPERATURES]
    best = int(np.argmin(losses))
    return float(TEMPERATURES[best]), losses[best]
