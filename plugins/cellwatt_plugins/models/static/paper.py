"""The three methods of the paper: gravity of the CAD model, a plain network, and a network of gravity's residual."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.progress import steps
from cellwatt.scheduler import spread

SEED: Final = 0
"""Seed of the split into training and testing, of the search and of the networks' first weights."""
NEURONS: Final = (8, 1000)
"""The paper's range of hidden neurons."""
TRIALS: Final = 20
"""Number of networks that the search trains for each method …"""
DRAWN: Final = 10
"""… the first of which have random sizes."""
TEST: Final = 0.2
"""Share of the poses that is held out for testing."""
_VALIDATION: Final = 0.2  # of the rest, for the search: it does not use the test
EPOCHS: Final = 100
"""Neither the number of epochs nor the batch size is in the paper."""
_BATCH: Final = 32


@dataclass(frozen=True)
class Sigmoids:
    """One hidden layer of sigmoids; scaling of inputs (N, k) and of the output (N,) included."""

    centre: Float
    scale: Float
    hidden: Float
    """(k, neurons)."""
    bias: Float
    out: Float
    """(neurons,)."""
    offset: float

    @property
    def neurons(self) -> int:
        """Number of hidden neurons."""
        return len(self.bias)

    def __call__(self, inputs: Float) -> Float:
        """Outputs (N,)."""
        return np.asarray(self.column(inputs)[:, 0])

    def column(self, inputs: Any) -> Any:
        """Outputs (N, 1) for an array or a ``Tensor``."""
        z = (inputs - self.centre) / self.scale @ self.hidden + self.bias
        return 1.0 / (1.0 + np.exp(-z)) @ self.out[:, None] + self.offset


def split(count: int, share: float = TEST) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows for training and for testing; ``share`` of the rows are for testing.

    The paper states 80/20 but n = 132 of 532 in the test, which is 24.8 %: a fifth is 106.
    """
    rows = np.random.default_rng(SEED).permutation(count)
    test = max(1, round(share * count))
    return np.sort(rows[test:]), np.sort(rows[:test])


Pair = tuple[Float, Float]
"""Inputs (N, k) and targets (N,)."""


def searched(pairs: Sequence[Pair]) -> list[Sigmoids]:
    """For each of some ``pairs`` the network with the best number of neurons according to tree-structured Parzen
    estimators, trained on all rows."""
    return spread(_best, pairs, "networks of the best size")


def _best(pair: Pair) -> Sigmoids:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(n_startup_trials=DRAWN, seed=SEED))
    for _ in steps(range(TRIALS), "network"):
        trial = study.ask()
        study.tell(trial, _error(*pair, trial.suggest_int("neurons", *NEURONS)))
    return trained(*pair, int(study.best_params["neurons"]))


def _error(inputs: Float, target: Float, neurons: int) -> float:
    """Mean square error on held-out rows of a network with this number of neurons."""
    rows = np.random.default_rng(SEED).permutation(len(inputs))
    held, rows = np.split(rows, [max(1, round(_VALIDATION * len(rows)))])
    learnt = trained(inputs[rows], target[rows], neurons)
    return float(np.mean((learnt(inputs[held]) - target[held]) ** 2))


def trained(inputs: Float, target: Float, neurons: int, epochs: int = EPOCHS) -> Sigmoids:
    """One network, trained with Adam; more ``epochs`` continue the same training."""
    from sklearn.exceptions import ConvergenceWarning  # type: ignore[import-untyped]
    from sklearn.neural_network import MLPRegressor  # type: ignore[import-untyped]

    spread = inputs.std(axis=0)
    scale = np.where(spread > 1e-9 * (1.0 + np.abs(inputs).max()), spread, 1.0)
    centre, middle, width = inputs.mean(axis=0), float(target.mean()), float(target.std()) or 1.0
    network = MLPRegressor(
        hidden_layer_sizes=(neurons,),
        activation="logistic",
        solver="adam",
        alpha=0.0,
        batch_size=min(_BATCH, len(inputs)),
        max_iter=epochs,
        n_iter_no_change=epochs,
        random_state=SEED,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit((inputs - centre) / scale, (target - middle) / width)
    (hidden, out), (bias, last) = network.coefs_, network.intercepts_
    return Sigmoids(centre, scale, hidden, bias, out[:, 0] * width, float(last[0]) * width + middle)
