"""From moves to a model file and to what is known of its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt.progress import stage, steps
from cellwatt_plugins.models.power.design import Rows
from cellwatt_plugins.models.power.fitting import Fitted, Structure, fit, structure_of
from cellwatt_plugins.models.power.folds import FEW, TURNS, folds_of
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import Seen
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.shown import through_its_meter
from cellwatt_plugins.models.power.smoothing import noise_of
from cellwatt_plugins.models.power.tuning import Tuning, tune
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter import Meter

Float = NDArray[np.float64]
SHARES: Final = (0.05, 0.15, 0.65, 0.15)
"""Of the time of a training: smoothing, effects, folds, and the model of all moves, about."""

METHODS: Final = ("NLS", "SCG", "best")
BEST: Final = "best"
AHEAD: Final = True
"""True if windows reach ahead of the value that is estimated."""


@dataclass(frozen=True)
class Trained:
    """A model, and the errors of all methods on moves that they were not fitted to."""

    fitted: Fitted
    nls: Nls | None
    """None where no current was measured, as the next."""
    scg: Scg | None
    tuning: Tuning
    predictions: dict[str, tuple[Float, Float]]
    """Power (N,) and currents (N, n) by method, each row by a model that has not seen its move."""
    scores: dict[str, Score]
    faster: dict[str, Score]
    """On the fastest moves, by models of slower ones only; empty where there are too few moves."""
    slower: dict[str, Score]
    power_noise: float
    """W: white noise of the measured power; NaN where not measured."""
    current_noise: Float
    """(n,) A."""
    meter: Meter | None
    """The slow meter that power is from."""


def train(moves: Moves, arm: Arm, seed: int = 0) -> Trained:
    """Chooses, fits, and judges by leaving moves out. The same moves and seed give the same model."""
    with stage("", sum(SHARES)):
        return _train(moves, arm, seed)


def _train(moves: Moves, arm: Arm, seed: int) -> Trained:
    check_known(arm)
    moves = through_its_meter(moves, arm)
    with stage("smoothing of the encoders", share=SHARES[0]):
        tuning = tune(moves, arm, AHEAD)
    with stage("choosing effects", share=SHARES[1]):
        structure = structure_of(moves, arm, tuning)
    fold = folds_of(moves)
    which = np.unique(fold)
    methods = METHODS if np.isfinite(moves.current).any() else (BEST,)
    predictions = {method: (np.full(len(moves), np.nan), np.full(moves.q.shape, np.nan)) for method in methods}
    for k in steps(which, "fold", share=SHARES[2]):
        held = fold == k
        known, unknown = moves.where(~held), moves.where(held)
        # Of so few, what is left out would have a say in the choice of windows and effects.
        windows = tune(known, arm, AHEAD) if moves.count < FEW else tuning
        effects = structure_of(known, arm, windows) if moves.count < FEW else structure
        for method in steps(methods, "method", lambda method: method):
            power, current = _held_out(method, known, unknown, arm, windows, effects, seed)
            predictions[method][0][held], predictions[method][1][held] = power, current
    with stage("all moves", 3, share=SHARES[3]):
        with stage("best"):
            fitted = fit(moves, arm, tuning, structure)
        seen = Seen.of(moves, arm, tuning) if methods == METHODS else None
        with stage("NLS"):
            nls = None if seen is None else Nls.fit(moves, seen, arm.description)
        with stage("SCG"):
            scg = None if seen is None else Scg.fit(moves, seen, seed)
    many = moves.count >= FEW
    return Trained(
        fitted=fitted,
        nls=nls,
        scg=scg,
        tuning=tuning,
        predictions=predictions,
        scores=_scores(moves, predictions, np.ones(len(moves), bool)),
        faster=_scores(moves, predictions, fold == TURNS + 1) if many else {},
        slower=_scores(moves, predictions, fold == TURNS) if many else {},
        power_noise=float(noise_of(moves.power)[0]) if moves.meter is None else np.nan,
        current_noise=noise_of(moves.current),
        meter=moves.meter,
    )


def model_of(moves: Moves, arm: Arm) -> Fitted:
    """The best model alone, without judging it: for short recordings and the demonstration, in seconds."""
    check_known(arm)
    moves = through_its_meter(moves, arm)
    tuning = tune(moves, arm, AHEAD)
    return fit(moves, arm, tuning, structure_of(moves, arm, tuning))


def check_known(arm: Arm) -> None:
    """Raises ``ConfigError`` where a torque constant is missing: currents say nothing without it."""
    if lacking := [joint.name for joint in arm.description.joints if not joint.torque_constant]:
        raise ConfigError(
            f"torque_constant of {', '.join(lacking)} is missing in robot.yaml (Nm/A at the joint): "
            "write the data sheet's, 20 % off is near enough"
        )


def estimate(fitted: Fitted, moves: Moves, arm: Arm) -> tuple[Float, Float]:
    """Power (N,) W and currents (N, n) A of other moves."""
    model = fitted.model
    rows = Rows.of(moves, model.smoother, arm.column("torque_constant"), len(moves), whole=False)
    if model.temperature is not None and moves.temperature is not None:
        rows = rows.with_temperature(moves.temperature, model.temperature)
    return model.estimate(rows, arm.body)


def _held_out(
    method: str,
    known: Moves,
    unknown: Moves,
    arm: Arm,
    tuning: Tuning,
    structure: Structure,
    seed: int,
) -> tuple[Float, Float]:
    """Return the predictions for some moves of a method that was fitted to others."""
    if method == BEST:
        return estimate(fit(known, arm, tuning, structure), unknown, arm)
    seen, unseen = Seen.of(known, arm, tuning), Seen.of(unknown, arm, tuning)
    return (Nls.fit(known, seen, arm.description) if method == "NLS" else Scg.fit(known, seen, seed)).predict(unseen)


def _scores(moves: Moves, predictions: dict[str, tuple[Float, Float]], rows: NDArray[np.bool_]) -> dict[str, Score]:
    some = moves.where(rows)
    return {method: Score.of(some, power[rows], current[rows]) for method, (power, current) in predictions.items()}
