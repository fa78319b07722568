"""Training of a power model from moves, and its errors on held-out moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.progress import stage
from cellwatt.scheduler import spread
from cellwatt_plugins.models.power.design import Rows
from cellwatt_plugins.models.power.fitting import Fitted, Structure, fit, structure_of
from cellwatt_plugins.models.power.folds import FEW, TURNS, folds_of
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import BESIDE, Seen
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.shown import through_its_meter
from cellwatt_plugins.models.power.smoothing import noise_of
from cellwatt_plugins.models.power.tuning import Tuning, tune
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter.model import Meter

Predictions = dict[str, tuple[Float, Float]]
"""Power (N,) W and currents (N, n) A by method."""
SHARES: Final = (0.05, 0.15, 0.8)
"""Approximate shares of a training's time: smoothing, effects, and the models of the folds and of all moves."""

METHODS: Final = ("NLS", "SCG", "best")
BEST: Final = "best"


@dataclass(frozen=True)
class Trained:
    """A model, and the errors of all methods on held-out moves."""

    fitted: Fitted
    nls: Nls | None
    """None if the current of a joint was not measured; ``scg`` likewise."""
    scg: Scg | None
    tuning: Tuning
    predictions: Predictions
    """Power (N,) and currents (N, n) by method; each row is from a model that was not trained on its move."""
    scores: dict[str, Score]
    faster: dict[str, Score]
    """Scores on the fastest moves, of models of slower moves only; empty if there are too few moves."""
    slower: dict[str, Score]
    power_noise: float
    """White noise of the measured power, W; NaN if not measured."""
    current_noise: Float
    """White noise (n,) of the measured currents, A."""
    meter: Meter | None
    """The slow meter that measured the power."""


@stage("", sum(SHARES))
def train(moves: Moves, arm: Arm) -> Trained:
    """Select, fit, and score on held-out moves. The same moves give the same model.

    Raises ``ConfigError`` if a torque constant is missing: without it, currents give no torque.
    """
    if lacking := [joint.name for joint in arm.description.joints if not joint.torque_constant]:
        raise ConfigError(
            f"torque_constant of {', '.join(lacking)} is missing in robot.yaml (Nm/A at the joint): "
            "write the data sheet's; an error of 20 % does no harm"
        )
    moves = through_its_meter(moves, arm)
    with stage("smoothing of the encoders", share=SHARES[0]):
        tuning = tune(moves, arm)
    with stage("choosing effects", share=SHARES[1]):
        structure = structure_of(moves, arm, tuning)
    fold = folds_of(moves)
    methods = METHODS if np.isfinite(moves.current).any(axis=0).all() else (BEST,)
    with stage("folds and all moves", 2, share=SHARES[2]):
        models, predictions = _fitted(_Known(moves, arm, fold), methods, tuning, structure)
    many = moves.count >= FEW
    return Trained(
        fitted=models[BEST],
        nls=models.get("NLS"),
        scg=models.get("SCG"),
        tuning=tuning,
        predictions=predictions,
        scores=_scores(moves, predictions, np.ones(len(moves), bool)),
        faster=_scores(moves, predictions, fold == TURNS + 1) if many else {},
        slower=_scores(moves, predictions, fold == TURNS) if many else {},
        power_noise=float(noise_of(moves.power)[0]) if moves.meter is None else np.nan,
        current_noise=noise_of(moves.current),
        meter=moves.meter,
    )


def estimate(fitted: Fitted, moves: Moves, arm: Arm) -> tuple[Float, Float]:
    """Power (N,) W and currents (N, n) A of other moves."""
    model = fitted.model
    rows = Rows.of(moves, model.smoother, arm.column("torque_constant"), len(moves), whole=False)
    if model.temperature is not None and moves.temperature is not None:
        rows = rows.with_temperature(moves.temperature, model.temperature)
    return model.estimate(rows, arm.body)


@dataclass(frozen=True)
class _Known:
    """Moves of an arm, and the ``fold`` (N,) of each row."""

    moves: Moves
    arm: Arm
    fold: NDArray[np.int64]


_Part = tuple[str, int | None, Tuning, Structure]
"""One method, fitted to all moves but those of a fold, or to all of them if the fold is None."""


def _fitted(
    known: _Known, methods: Sequence[str], tuning: Tuning, structure: Structure
) -> tuple[dict[str, Any], Predictions]:
    """The model of each method, and the predictions of held-out moves by models of the others."""
    moves, which = known.moves, np.unique(known.fold).tolist()
    chosen = [(tuning, structure)] * len(which)
    if moves.count < FEW:  # of so few moves, a held-out one would influence the choice of windows and effects
        chosen = spread(_chosen, which, "choosing effects without fold", shared=known)
    folds = [*zip(which, chosen, strict=True), (None, (tuning, structure))]
    parts: list[_Part] = [(method, k, *own) for k, own in folds for method in methods]
    models: dict[str, Any] = {}
    predictions = {method: (np.full(len(moves), np.nan), np.full(moves.q.shape, np.nan)) for method in methods}
    for (method, k, *_), found in zip(parts, spread(_done, parts, "methods and folds", shared=known), strict=True):
        if k is None:
            models[method] = found
            continue
        for whole, some in zip(predictions[method], found, strict=True):
            whole[known.fold == k] = some
    return models, predictions


def _chosen(k: int, known: _Known) -> tuple[Tuning, Structure]:
    """Select windows and effects from all moves but those of a fold."""
    moves = known.moves.where(known.fold != k)
    tuning = tune(moves, known.arm)
    return tuning, structure_of(moves, known.arm, tuning)


def _done(part: _Part, known: _Known) -> Any:
    """Return the model of all moves, or, for a fold, its predictions by a model fitted to the other folds.

    A fold that is a block of a move is predicted with the motion around the block, and what was measured in the rows
    around is not used: the arm is not at rest at the ends of the block.
    """
    method, k, tuning, structure = part
    arm, held = known.arm, known.fold == (-1 if k is None else k)
    near = known.moves.around(held, tuning.smoother.window + BESIDE)
    moves = known.moves.unmeasured(near & ~held).where(~held)
    model: Any
    if method == BEST:
        model = fit(moves, arm, tuning, structure)
    else:
        seen = Seen.of(moves, arm, tuning)
        model = Nls.fit(moves, seen, arm.description) if method == "NLS" else Scg.fit(moves, seen)
    if k is None:
        return model
    unseen = known.moves.where(near)
    said = estimate(model, unseen, arm) if method == BEST else model.predict(Seen.of(unseen, arm, tuning))
    return tuple(each[held[near]] for each in said)


def _scores(moves: Moves, predictions: Predictions, rows: NDArray[np.bool_]) -> dict[str, Score]:
    some = moves.where(rows)
    return {method: Score.of(some, power[rows], current[rows]) for method, (power, current) in predictions.items()}
