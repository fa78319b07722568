"""One case's answer against its key: names, places, parameters, and the error on the sealed runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from concealed.arms import Array
from concealed.files import Run

Row = dict[str, Any]
Pair = tuple[str, int | None]
Residuals = Callable[[str], tuple[Array, Array] | None]
NOT_PREDICTABLE = {"external_contact", "payload_change", "unknown"}
"""Effects whose course in time does not follow from the planned motion: named and placed, not predicted."""
TOUCHED = 1.15
"""A channel counts for the gap where the simulation's error is this many times that of the best possible model."""
IN_SI = {"N*m/min": 1 / 60, "N*m/h": 1 / 3600, "ms": 1e-3, "min": 60.0, "deg": np.pi / 180}
"""What one of a unit is in the units of the keys, where an answer need not use them."""
NOT_COMPARED = {
    ("temperature_dependent_friction", "scale"),
    ("temperature_dependent_friction", "time_constant"),
    ("winding_temperature", "time_constant"),
    ("fan_switching", "start_temperature"),
    ("fan_switching", "on_above"),
    ("fan_switching", "off_below"),
    ("fan_switching", "time_constant"),
    ("backlash", "stiffness"),
    ("backlash", "damping"),
    ("joint_elasticity", "damping"),
    ("external_contact", "width"),
}
"""Parameters that two people would define differently: shape of a push, time constants of unseen temperatures."""


def named(findings: list[Row]) -> set[Pair]:
    """What an answer calls missing."""
    return {(f["effect"], f["joint"]) for f in findings if f.get("kind", "missing") == "missing"}


def truth_of(key: Row) -> set[Pair]:
    """What is missing."""
    return {(r["effect"], r["joint"]) for r in key["required"]}


def flat(parameters: Row) -> dict[str, float]:
    """Scalars of a key's entry; a centre of mass becomes com_x, com_y, com_z."""
    out: dict[str, float] = {}
    for name, value in parameters.items():
        if name == "com":
            out |= {f"com_{axis}": float(x) for axis, x in zip("xyz", value, strict=True)}
        elif isinstance(value, int | float) and not isinstance(value, bool):
            out[name] = float(value)
    return out


def comparisons(key: Row, findings: list[Row]) -> list[Row]:
    """Truth beside estimate for each parameter of a rightly named effect that both sides define alike."""
    out = []
    for entry, required in zip(key["effects"], key["required"], strict=True):
        pair = (required["effect"], required["joint"])
        found = next((f for f in findings if (f["effect"], f["joint"]) == pair), None)
        if found is None or required["effect"] == "unknown":
            continue
        given = {k: p for k, p in found.get("parameters", {}).items() if p.get("value") is not None}
        for name, true in flat({k: v for k, v in entry.items() if k not in ("effect", "joint", "strength")}).items():
            if name in given and (entry["effect"], name) not in NOT_COMPARED and same_form(entry, given, name):
                out.append(compared(entry["effect"], name, true, given[name]))
    return out


def compared(effect: str, name: str, true: float, given: Row) -> Row:
    """One estimate against the truth; the error is a share, where a share means something."""
    unit = IN_SI.get(given.get("unit", ""), 1.0)
    value, std = unit * float(given["value"]), unit * float(given.get("std") or np.nan)
    error = difference(name, value, true)
    placed = name.startswith("com_") or name in ("phase", "rest", "roll", "pitch", "time")
    return {
        "effect": effect,
        "parameter": name,
        "true": true,
        "value": value,
        "std": std,
        "error": None if placed or true == 0 else abs(error) / abs(true),
        "covered": bool(abs(error) <= 1.96 * std) if np.isfinite(std) and std > 0 else None,
    }


def same_form(entry: Row, given: Row, name: str) -> bool:
    """Whether a coefficient belongs to the same formula: the same power of speed, the same number of cycles."""
    for form in ("exponent", "cycles"):
        if form in entry and name != form and form in given:
            return bool(abs(float(given[form]["value"]) - entry[form]) < 0.02 * entry[form])
    return not ("exponent" in entry and name == "coefficient" and "exponent" not in given)


def difference(name: str, value: float, true: float) -> float:
    """Estimate minus truth; a phase is taken round the circle."""
    return float((value - true + np.pi) % (2 * np.pi) - np.pi) if name == "phase" else value - true


def strength_of(key: Row) -> str | None:
    """Weak, medium or strong by what the plant's recordings hold: below 3, below 6, or more times the noise."""
    if not key["required"]:
        return None
    return "weak" if key["ratio"] < 3 else "medium" if key["ratio"] < 6 else "strong"


def predictable(key: Row) -> bool:
    """Whether the sealed runs follow from their motion."""
    return not {e for e, _ in truth_of(key)} & NOT_PREDICTABLE


def hold_out(key: Row, left: Residuals) -> list[Row]:
    """Per touched channel of the sealed runs: error of the simulation, of the model, and of the best possible model.

    `left` gives residual torque (N, n) and power (N,) of a run by its name, None where the model has no prediction. A
    run without such a channel is not asked for.
    """
    rows = []
    for run in (r for r in key["runs"] if r["split"] == "sealed"):
        before = np.array([*run["rmse_simulation"], run["power_rmse_simulation"]])
        best = np.array([*run["rmse_oracle"], run["power_rmse_oracle"]])
        if not (touched := np.flatnonzero(before >= TOUCHED * best)).size:
            continue
        got = left(run["run"])
        for c in map(int, touched):
            simulation, oracle = float(before[c]), float(best[c])
            model = None if got is None else channel_rms(got, c)
            rows.append(
                {
                    "run": run["run"],
                    "channel": f"tau_{c + 1}" if c < len(best) - 1 else "power",
                    "simulation": simulation,
                    "model": model,
                    "oracle": oracle,
                    "gap_closed": None if model is None else (simulation - model) / (simulation - oracle),
                }
            )
    return rows


def channel_rms(residual: tuple[Array, Array], c: int) -> float:
    """RMS of one joint's torque, or of the power after the last joint."""
    torque, power = residual
    return float(np.sqrt(np.mean(np.square(torque[:, c] if c < torque.shape[1] else power))))


def residual_of(run: Run, predicted: tuple[Array, Array]) -> tuple[Array, Array]:
    """Residual torque (N, n) and power (N,) of a prediction."""
    return run.measured - predicted[0], run.measured_power - predicted[1]


def score(key: Row, findings: list[Row], unexplained: list[Row], gaps: list[Row]) -> Row:
    """The figures of one case for one method."""
    truth = truth_of(key)
    said = named(findings) - {
        (a["effect"], a["joint"]) for a in key["allowed"] if (a["effect"], a["joint"]) not in truth
    }
    listed = {(a["effect"], a["joint"]) for f in findings for a in f.get("alternatives", [])}
    show = lambda pairs: sorted(f"{e}@{j if j else '-'}" for e, j in pairs)  # noqa: E731
    where = {j for e, j in truth if j is not None}
    return {
        "truth": show(truth),
        "named": show(said),
        "exact": truth == said,
        "hit": len(truth & said),
        "false": len(said - truth),
        "missed": len(truth - said),
        "listed": len((truth - said) & listed),
        "joints": len(where),
        "joints_found": len(where & {j for _, j in said}),
        "unexplained": sorted({str(u.get("channel")) for u in unexplained}),
        "parameters": comparisons(key, findings),
        "hold_out": gaps if predictable(key) else [],
    }
