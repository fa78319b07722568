"""Results of a training as tables for a person, and as JSON."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cellwatt.report.blocks import Table
from cellwatt.report.numbers import fixed
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.nls import JOINT_NUMBERS, Nls
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.training import BEST, Trained

EFFICIENCIES: Final = (0.4, 1.5)
"""Efficiencies of a supply that can be; above 1 for torque constants that are stated too low."""


def as_json(trained: Trained, moves: Moves) -> dict[str, Any]:
    """The content of ``power.json``."""
    fitted = trained.fitted
    return {
        "moves": moves.count,
        "rows": len(moves),
        "rate_hz": 1 / moves.step,
        "power_noise_watt": _number(trained.power_noise),
        "current_noise_ampere": [_number(each) for each in trained.current_noise],
        "held_out": _scores(trained.scores),
        "fastest_moves_held_out": _scores(trained.faster),
        "slowest_moves_held_out": _scores(trained.slower),
        "best": {
            "effects": list(fitted.structure.effects),
            "losses": list(fitted.structure.losses),
            "sharing": fitted.structure.sharing,
            "parameters": parameters(trained),
            "friction_turns_over_within": fitted.model.width,
            "window": fitted.model.smoother.window,
        },
        "nls": None if trained.nls is None else _nls(trained.nls),
    }


def parameters(trained: Trained) -> dict[str, Any]:
    """The best model's coefficients: terms of the torque by joint, and the supply."""
    model = trained.fitted.model
    out: dict[str, Any] = {
        name: [round(float(x), 5) for x in row] for name, row in zip(model.terms, model.weights, strict=True)
    }
    if model.supply is not None:
        supply = model.supply
        out |= {
            "standby_watt": supply.standby,
            "efficiency": supply.efficiency,
            "share_of_returned_energy_used": supply.used,
            "brakes_watt": supply.brakes,
        }
        out |= {f"supply {n}": w.tolist() for n, w in zip(supply.terms, supply.weights, strict=True)}
    return out


def in_words(trained: Trained, moves: Moves, files: list[str]) -> str:
    """The report for the terminal."""
    parts = [f"{moves.count} moves, {len(moves)} rows at {1 / moves.step:.4g} Hz"]
    parts += [table.text() for table in rivals(trained)]
    return "\n".join([*parts, *findings(trained), f"written: {', '.join(files)}"])


def rivals(trained: Trained) -> list[Table]:
    """The errors of all methods on held-out moves, and on the fastest and the slowest, if these were held out."""
    groups = (
        ("Moves held out", trained.scores),
        ("Fastest moves, trained on slower ones", trained.faster),
        ("Slowest moves, trained on faster ones", trained.slower),
    )
    return [_rivals(title, scores) for title, scores in groups if scores]


def _rivals(title: str, scores: dict[str, Score]) -> Table:
    joints = len(next(iter(scores.values())).current)
    heads = ["method", "energy error, mean, %", "worst, %", "power RMSE, W"]
    heads += [f"current {j + 1}, %" for j in range(joints)]
    rows = [
        [
            name,
            *(fixed(value, 2) for value in (score.energy_mean, score.energy_worst, score.power)),
            *(fixed(None if value is None else 100 * value, 1) for value in score.current),
        ]
        for name, score in scores.items()
    ]
    return Table(title, heads, rows)


def findings(trained: Trained) -> list[str]:
    """Effects, losses, supply and doubts of the models, a line each."""
    structure, model = trained.fitted.structure, trained.fitted.model
    lines = [f"{BEST}: rigid bodies, rotors, Coulomb and viscous friction of each joint"]
    lines += [f"  + {effect}" for effect in (*structure.effects, *structure.losses)]
    if model.supply is not None:
        supply = model.supply
        lines.append(
            f"  supply: {supply.standby:.1f} W standby, efficiency {supply.efficiency:.3f}, {100 * supply.used:.0f} % "
            "of the energy that drives return is used"
        )
        if not EFFICIENCIES[0] < supply.efficiency < EFFICIENCIES[1]:
            lines.append(
                "  this efficiency is impossible, power does not follow the motion: is it of this arm, in W, and "
                "positive when drawn?"
            )
    if trained.nls is not None:
        lines += [f"NLS: {doubt}" for doubt in trained.nls.doubts]
    if trained.meter is not None:
        meter = trained.meter.description
        lines.append(f"  power is from a slow meter ({meter}): compared with means over the same times")
    if np.isfinite(trained.power_noise):
        lines.append(f"  noise of the measured power: {trained.power_noise:.2f} W")
    return lines


def _scores(scores: dict[str, Score]) -> dict[str, Any]:
    return {
        name: {
            "energy_error_percent": list(score.energy),
            "energy_error_mean_percent": score.energy_mean,
            "energy_error_worst_percent": score.energy_worst,
            "power_rmse_watt": score.power,
            "current_relative_rmse": list(score.current),
            "current_rmse_ampere": list(score.current_rms),
        }
        for name, score in scores.items()
    }


def _nls(nls: Nls) -> dict[str, Any]:
    """Parameters with their standard errors, by joint and of equation (13), and those that compensate for effects."""
    n = len(nls.joints)
    names = [JOINT_NUMBERS, ("P_c", *(f"{name}_{i + 1}" for name in ("L", "R") for i in range(n)))]
    joints = [
        {name: [_number(v), _number(e)] for name, v, e in zip(names[0], values, errors, strict=True)}
        for values, errors in zip(nls.joints, nls.errors[0], strict=True)
    ]
    power = {name: [_number(v), _number(e)] for name, v, e in zip(names[1], nls.power, nls.errors[1], strict=True)}
    return {"joints": joints, "power": power, "doubts": list(nls.doubts)}


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
