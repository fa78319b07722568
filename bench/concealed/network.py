"""Baseline: a black-box network that learns from motion what a refit of the nominal parameters leaves.

It can name nothing. It is scored as saying `unknown` at each joint (or at the supply) where it explains held-out
residual that the refit leaves, because that is all that such a model tells an engineer.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import StandardScaler

from concealed.arms import Array
from concealed.files import Robot, Run, thinned
from concealed.refit import ROWS, Refit, refit

EXPLAINED = 0.1
"""Share of a channel's held-out residual variance that must be explained before the network speaks up."""
BLOCK_SECONDS = 3.0


def features(run: Run) -> Array:
    """(N, 4 n) position, velocity, acceleration and direction of motion of all joints."""
    return np.concatenate([run.q, run.v, run.a, np.tanh(run.v / 0.01)], axis=1)


def train(x: Array, y: Array, seed: int = 0) -> MLPRegressor:
    """A small network with two hidden layers."""
    net = MLPRegressor(
        hidden_layer_sizes=(48, 32), alpha=1e-3, learning_rate_init=3e-3, max_iter=60, batch_size=128, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return net.fit(x, y)


@dataclass(frozen=True)
class BlackBox:
    """Refit plus network; `findings` in the contract's form."""

    base: Refit
    inputs: StandardScaler
    outputs: StandardScaler
    net: MLPRegressor
    helps: Array
    findings: list[dict[str, object]]

    def left(self, run: Run) -> tuple[Array, Array]:
        """Residual torque (N, n) and power (N,) of a run; the network adds where it helped on blocks left out."""
        torque, power = self.base.left(run)
        add = self.outputs.inverse_transform(self.net.predict(self.inputs.transform(features(run)))) * self.helps
        return torque - add[:, :-1], power - add[:, -1]


def explain(robot: Robot, runs: Sequence[Run], base: Refit | None = None) -> BlackBox:
    """Train on all runs; where blocks of time that were left out are predicted too, say `unknown`."""
    base = base or refit(robot, runs)
    total = sum(len(r.t) for r in runs)
    few = [thinned(r, max(200, ROWS * len(r.t) // total)) for r in runs]
    left = [base.left(r) for r in few]
    y = np.concatenate([np.concatenate([torque, power[:, None]], axis=1) for torque, power in left])
    x = np.concatenate([features(r) for r in few])
    inputs, outputs = StandardScaler().fit(x), StandardScaler().fit(y)
    a, b = inputs.transform(x), outputs.transform(y)
    block = np.concatenate([np.floor(r.t / BLOCK_SECONDS) + 1000 * k for k, r in enumerate(few)])
    test = np.asarray(block % 4 == 1)
    guess = train(a[~test], b[~test]).predict(a[test])
    gain = 1 - np.mean((b[test] - guess) ** 2, axis=0) / np.mean(b[test] ** 2, axis=0)
    speaks = np.flatnonzero(gain > EXPLAINED)
    findings: list[dict[str, object]] = [
        {"effect": "unknown", "joint": int(c) + 1 if c < robot.joints else None, "kind": "missing"} for c in speaks
    ]
    return BlackBox(base, inputs, outputs, train(a, b), gain > 0.0, findings)
