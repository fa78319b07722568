"""Fits the model: torque by its columns, effects by their gain on held-out moves, then all coefficients together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power import leftover
from cellwatt_plugins.models.power import supply as supplies
from cellwatt_plugins.models.power import torque as torques
from cellwatt_plugins.models.power.design import Rows, shared_columns
from cellwatt_plugins.models.power.folds import HARM, folds_of
from cellwatt_plugins.models.power.hybrid import Hybrid
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.problem import MOST, Problem
from cellwatt_plugins.models.power.supply import Sharing
from cellwatt_plugins.models.power.terms import WARM
from cellwatt_plugins.models.power.together import fit_together
from cellwatt_plugins.models.power.tuning import DOUBT, Tuning
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.signs import opposite, to_and_fro

DOUBTS: Final = (1.0, 3.0, 10.0)
"""Factors on the tolerances of the URDF's links that are tried on held-out moves."""
USUAL: Final = ("Stribeck friction (0.1 rad/s)",)
"""Effects of an arm whose currents were not measured: power alone does not show others."""
WEIGHINGS: Final = 2
"""Number of times that rows are weighed by their residuals, after the first fit."""
HELPS: Final = 0.95
"""Share to which a network must reduce the mean square of the torques' held-out error."""
TRIALS: Final = 4
"""Number of folds on which a network is tried."""


@dataclass(frozen=True)
class Structure:
    """Structure of a model, without its coefficients."""

    effects: tuple[str, ...]
    losses: tuple[str, ...]
    sharing: Sharing
    doubt: float
    """Factor on the tolerances of the URDF's links."""
    network: bool = False
    """True if a network models the torque residuals of the physics."""


@dataclass(frozen=True)
class Fitted:
    """A model, its structure and its standard errors."""

    model: Hybrid
    structure: Structure
    errors: Float
    """Standard errors of the inertial parameters, of the weights by joint, and of the supply; NaN if no power was
    measured."""


def structure_of(moves: Moves, arm: Arm, tuning: Tuning) -> Structure:
    """Effects and losses that hold on held-out moves, among them the fastest and the slowest.

    Raises ``RecordingError`` if a current has the opposite sign.
    """
    problem = Problem.of(moves, arm, tuning, DOUBT)
    rows = problem.rows
    turned = opposite(rows.torque, problem.design.shared @ problem.belief.shared.mean, rows.qd, loss=0.0)
    if (turned := turned & to_and_fro(rows.qd)).any():
        joints = ", ".join(arm.description.names[j] for j in np.flatnonzero(turned))
        raise RecordingError(
            f"the current of {joints} has the opposite sign: it drives where the motion requires braking"
        )
    fold = folds_of(moves)[rows.at]
    if not np.isfinite(rows.torque).any():
        usual = tuple(effect for effect in USUAL if effect in problem.effects)
        return Structure(usual, (), "bus", DOUBT)
    problem, effects, doubt = _effects(problem, fold)
    losses: tuple[str, ...] = ()
    sharing: Sharing = "bus"
    if len((shown := rows.shown).power):
        drive = problem.drive(problem.solution(effects), shown.rows)
        losses, sharing = supplies.select(drive, shown.power, fold[shown.at], arm.description, shown.matrix)
    structure = Structure(effects, losses, sharing, doubt)
    return replace(structure, network=_network_helps(moves, arm, tuning, structure))


def _effects(problem: Problem, fold: NDArray[np.int64]) -> tuple[Problem, tuple[str, ...], float]:
    """Effects of the torque, selected twice as the rows' weights depend on them, and the factor on links'
    tolerances."""
    effects: tuple[str, ...] = ()
    known = np.unique(fold[np.isfinite(problem.rows.torque).any(axis=1)])
    for _ in range(2):
        folds = [problem.sums(fold == k) for k in known]
        effects = torques.select(folds, problem.belief, problem.design.names, problem.effects)
        problem = problem.reweighed(effects)
    chosen = problem.chosen(effects)
    scores = {doubt: torques.misfits(folds, problem.doubting(doubt), chosen).mean() for doubt in DOUBTS}
    return problem, effects, min(scores, key=lambda doubt: float(scores[doubt]))


def _network_helps(moves: Moves, arm: Arm, tuning: Tuning, structure: Structure) -> bool:
    """True if a network lowers the torques' error on held-out moves, the fastest and the slowest first."""
    if not np.isfinite(moves.current).all(axis=1).any():
        return False
    fold, blocks = folds_of(moves), moves.count < 3  # the arm is not at rest at the ends of a block
    ratios = []
    for k in np.unique(fold[np.isfinite(moves.current).any(axis=1)])[::-1][:TRIALS]:
        fitted = fit(moves.where(fold != k), arm, tuning, replace(structure, network=True))
        held = Rows.of(moves.where(fold == k), tuning.smoother, fitted.model.constant, MOST, whole=blocks)
        motion = fitted.model.motion(held, shared_columns(held, arm.body, fitted.model.carries(arm.joints)))
        with_it = held.torque - fitted.model.torque(motion)
        without = held.torque - replace(fitted.model, leftover=None).torque(motion)
        known = np.isfinite(without).any(axis=0)
        ratios.append(np.nanmean(with_it[:, known] ** 2, axis=0) / np.nanmean(without[:, known] ** 2, axis=0))
        if np.mean(ratios[-1]) > HARM:
            return False
    return bool(np.mean(np.concatenate(ratios)) < HELPS)


def fit(moves: Moves, arm: Arm, tuning: Tuning, structure: Structure) -> Fitted:
    """All coefficients of a structure: currents and power together, Gauss–Newton with priors."""
    problem = Problem.of(moves, arm, tuning, structure.doubt, structure.effects)
    for _ in range(WEIGHINGS):
        problem = problem.reweighed(structure.effects)
    chosen = problem.chosen(structure.effects)
    torque, supply = problem.solution(structure.effects), None
    errors = np.full(len(torque.row), np.nan)
    if len(problem.rows.shown.power):
        torque, supply, errors = fit_together(problem, chosen, torque, structure.losses, structure.sharing)
    warmth = moves.temperature if WARM in structure.effects else None
    scale = 1 + torque.own[0]
    model = Hybrid(
        smoother=tuning.smoother,
        width=tuning.width,
        inertial=torque.shared,
        terms=tuple(problem.design.names[i] for i in chosen[1:]),
        weights=torque.own[1:] / scale,
        constant=problem.constant / scale,
        resistance=supplies.resistances(arm.description),
        supply=supply,
        temperature=None if warmth is None else np.nanmean(warmth, axis=0),
    )
    if structure.network:
        motion = model.motion(problem.rows, problem.design.shared)
        residual = problem.rows.torque / scale - model.torque(motion)
        model = replace(model, leftover=leftover.train(motion, residual))
    return Fitted(model, structure, np.delete(errors, torque.at_gain))
