"""The page of ``train power``: measured and predicted power, residuals, compared methods, and the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from cellwatt.report import (
    Axis,
    Block,
    Figure,
    Notes,
    Panel,
    Provenance,
    Report,
    Section,
    Switch,
    Table,
    Tile,
    heading,
)
from cellwatt.report.drawing import curve
from cellwatt.report.numbers import fixed, measured
from cellwatt.report.theme import GOOD, MEASURED, MODEL, SIMULATION
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.training import BEST, Trained
from cellwatt_plugins.models.power.wording import findings, rivals
from cellwatt_plugins.models.report import residuals_by_joint

COLOURS: Final = {"NLS": SIMULATION, "SCG": GOOD, BEST: MODEL}
ROLES: Final = {"NLS": "simulation", "SCG": "good", BEST: "model"}
SHOWN = 3
"""Number of moves drawn over time."""
CURRENTS = "Currents: root mean square error of each joint, in per cent of the current's standard deviation."
OVER_TIME = "Each move is predicted by models that were not trained on it: the slowest, a medium and the fastest move."


def report(trained: Trained, moves: Moves, robot: str, provenance: Provenance) -> Report:
    """The page of a training."""
    best = trained.scores[BEST]
    if best.energy_mean is None:
        verdict = "The model predicts the currents of held-out moves; no power was measured."
    else:
        verdict = f"The model predicts the energy of held-out moves to {best.energy_mean:.2f} % on average"
        verdict += f", {best.energy_worst:.2f} % at worst."
    known = [(name, score) for name, score in trained.scores.items() if score.energy_mean is not None]
    return Report(
        name=robot,
        subject="current and power in motion",
        facts=["current and power in motion", f"{moves.count} moves", f"{len(moves)} rows at {1 / moves.step:.4g} Hz"],
        verdict=verdict,
        tiles=[
            Tile(name, f"{fixed(score.energy_mean, 2)} %", f"power {fixed(score.power, 2)} W rms", ROLES[name])
            for name, score in known
        ],
        tiles_remark="Mean energy error of a held-out move." if known else "",
        sections=[
            Section("Measured and predicted", _over_time(trained, moves), OVER_TIME),
            Section(
                "Residual of each joint", _residuals(trained, moves), "Measured minus predicted current over speed."
            ),
            Section("Methods", [b for table in rivals(trained) for b in (heading(table.label), table)], CURRENTS),
            Section("The best model", [Notes([text.strip() for text in findings(trained)]), *_parameters(trained)]),
        ],
        provenance=provenance,
    )


def _over_time(trained: Trained, moves: Moves) -> list[Block]:
    """Measured and predicted power of three moves, and the residual; nothing without power."""
    bounds = [(a, b) for a, b in moves.bounds() if np.isfinite(moves.power[a:b]).any()]
    speeds = [float(np.sqrt(np.mean(moves.qd[a:b] ** 2))) for a, b in bounds]
    order = np.argsort(speeds)
    picked = dict.fromkeys(order[[0, len(order) // 2, -1]].tolist()) if bounds else {}
    drawn = [_move(trained, moves, bounds[i], n) for n, i in enumerate(picked)]
    names = [f"move {int(moves.move[bounds[i][0]]) + 1}, {speeds[i]:.2f} rad/s rms" for i in picked]
    return [Switch("move", names), *drawn]


def _move(trained: Trained, moves: Moves, bounds: tuple[int, int], which: int) -> Figure:
    part = slice(*bounds)
    power, step = moves.power[part], moves.step
    upper = [curve("measured", power, MEASURED, step=step, width=2.4)]
    lower = []
    for name, (watts, _) in trained.predictions.items():
        upper.append(curve(name, watts[part], COLOURS[name], step=step))
        lower.append(curve(name, power - watts[part], COLOURS[name], step=step, width=1.1))
    rows = [[Panel(upper, Axis("s"), Axis("power, W"))], [Panel(lower, Axis("s"), Axis("measured −, W"))]]
    label = f"Power of move {which + 1} of {SHOWN}: measured and predicted, and the residual"
    return Figure(label, rows, (190, 110), "x", layout={"hovermode": "x unified"}, when=("move", which))


def _residuals(trained: Trained, moves: Moves) -> list[Block]:
    """Measured minus predicted current of each joint over its velocity."""
    if not np.isfinite(moves.current).any():
        return []
    label, residual = "Residual of each joint's current over its speed", moves.current - trained.predictions[BEST][1]
    return [residuals_by_joint(label, BEST, moves.qd, residual, ("rad/s", "A"))]


def _parameters(trained: Trained) -> Sequence[Block]:
    """Coefficients of the torque by joint, and of the supply, with standard errors if power was measured."""
    model, errors = trained.fitted.model, trained.fitted.errors
    shared, joints = len(model.inertial), model.weights.shape[1]
    unsure = errors[shared : shared + model.weights.size].reshape(joints, -1).T
    heads = ["Nm per unit of each term", *(f"joint {j + 1}" for j in range(joints))]
    rows = [
        [term, *(measured(v, s) for v, s in zip(values, spread, strict=True))]
        for term, values, spread in zip(model.terms, model.weights, unsure, strict=True)
    ]
    out = [Table("Torque", heads, rows)]
    if model.supply is not None:
        supply = model.supply
        names = ["standby, W", "drawn per W of the drives", "saved per W returned", "brakes, W"]
        names += [f"{term}, joint {j + 1}" for term in supply.terms for j in range(joints)]
        known = zip(names, supply.vector(), errors[shared + model.weights.size :], strict=True)
        out.append(Table("Supply", ("supply", "value"), [[name, measured(v, s)] for name, v, s in known]))
    return out
