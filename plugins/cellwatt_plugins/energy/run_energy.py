"""One run's consumer groups with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.clock import windows
from cellwatt_plugins.energy.drive import Drive, bus_power, supply_power
from cellwatt_plugins.energy.equations import (
    brake_energy,
    electrical_losses,
    electronics_energy,
    motion_efficiency,
)
from cellwatt_plugins.energy.findings import Fixed, RunEnergy
from cellwatt_plugins.energy.identify import Observed, residual
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.energy.split import edges, mechanical, total_energy
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.accumulate import Accumulated

Float = NDArray[np.float64]

TOO_WIDE = 1.0
"""Percent of the total: regeneration that is less certain is not told."""
BRAKING = 1.0
"""W of braking on the bus, from which a value of the analyzer shows how much of it is used."""
UNEXPLAINED = 0.2
"""Share of the braking power by which the analyzer may contradict the model before the split is refused."""


@dataclass(frozen=True)
class Whole:
    """One run with its complete repetitions, and ``notes`` on the others."""

    observed: Observed
    repetitions: tuple[Repetition, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Learnt:
    """What all runs together said of an arm: fixed power, its drive, and ``draws`` of that within its uncertainty."""

    arm: Arm
    fixed: Fixed
    drive: Drive
    draws: Sequence[Drive]


def run_energy(run: Whole, learnt: Learnt) -> RunEnergy:
    """Groups of one run as means over its repetitions (eqs 4, 5, 9 … 14, 17 … 19)."""
    one, repetitions, drive, fixed = run.observed, run.repetitions, learnt.drive, learnt.fixed
    best = _groups(one, drive, fixed, repetitions)
    spread = _uncertainty(one, learnt, repetitions)
    said = list(run.notes)
    if best["mechanical_losses"] < 0:
        said.append(
            f"mechanical losses of {best['mechanical_losses']:.1f} J measured, which cannot be: reported as 0; "
            "the torque is off by more than could be found out"
        )
        for name in ("electrical_losses_with_regeneration", "electrical_losses"):
            best[name] += best["mechanical_losses"]
        best["mechanical_losses"] = 0.0
    reason = _refusal(one, drive, best, spread)
    if reason:
        said.append(reason)
    return RunEnergy(
        run=one.run.name,
        speed_mm_s=one.run.speed,
        payload_kg=one.run.payload,
        repetitions=len(repetitions),
        electrical_losses=None if reason else best.pop("electrical_losses"),
        regeneration=None if reason else best.pop("regeneration"),
        analyzer_offset_s=one.offset.seconds,
        path_speed_mm_s=repetitions[0].path_speed(learnt.arm, one.run.motion),
        uncertainty={**spread, "analyzer_offset_s": one.offset.uncertainty},
        notes=tuple(said),
        **{name: value for name, value in best.items() if name not in ("electrical_losses", "regeneration")},
    )


def _groups(one: Observed, drive: Drive, fixed: Fixed, repetitions: Sequence[Repetition]) -> dict[str, float]:
    seconds = float(np.mean([repetition.seconds for repetition in repetitions]))
    moved = mechanical(one, drive, repetitions)
    total = float(total_energy(one, drive, repetitions).mean())
    electronics = electronics_energy(fixed.controller, fixed.robot_electronics, seconds)
    brakes = brake_energy(fixed.brakes, seconds)
    losses = float(moved.losses.sum(axis=1).mean())
    electrical = electrical_losses(total, electronics, brakes, losses)
    regeneration, positive = float(moved.regeneration.mean()), float(moved.positive.mean())
    return {
        "seconds": seconds,
        "total": total,
        "electronics": electronics,
        "brakes": brakes,
        "mechanical_losses": losses,
        "electrical_losses_with_regeneration": electrical,
        "electrical_losses": electrical - regeneration,
        "regeneration": regeneration,
        "regeneration_upper_bound": float(moved.negative.mean()),
        "positive_mechanical": positive,
        "motion_efficiency_percent": motion_efficiency(positive, total),
    }


def _uncertainty(one: Observed, learnt: Learnt, repetitions: Sequence[Repetition]) -> dict[str, float | None]:
    """One standard deviation of each group: parameters (draws), repetitions (their scatter), fixed power, edges."""
    fixed, drive = learnt.fixed, learnt.drive
    drawn = [mechanical(one, draw, repetitions) for draw in learnt.draws]
    own = mechanical(one, drive, repetitions)
    totals = total_energy(one, drive, repetitions)
    each = np.array([r.seconds for r in repetitions])
    seconds, edge = float(each.mean()), float(np.mean([r.uncertainty for r in repetitions]))
    power_e = float(np.hypot(fixed.controller_uncertainty, fixed.robot_electronics_uncertainty))
    rest, at_edges = fixed.electronics + fixed.brakes, _power_at_edges(one, drive, repetitions)
    losses = _combined([d.losses.sum(axis=1) for d in drawn], own.losses.sum(axis=1))
    regeneration = _combined([d.regeneration for d in drawn], own.regeneration)
    positive = _combined([d.positive for d in drawn], own.positive)
    # Edges move total, electronics and brakes alike; what remains of them is the power that holds the arm there.
    by_power = float(np.hypot(power_e, fixed.brakes_uncertainty)) * seconds
    scatter = _scatter(totals - rest * each - own.losses.sum(axis=1))
    left = float(np.linalg.norm([by_power, edge * (at_edges - rest), losses, scatter]))
    return {
        "seconds": edge,
        "total": float(np.hypot(_scatter(totals), edge * at_edges)),
        "electronics": float(np.hypot(power_e * seconds, edge * fixed.electronics)),
        "brakes": float(np.hypot(fixed.brakes_uncertainty * seconds, edge * fixed.brakes)),
        "mechanical_losses": losses,
        "electrical_losses_with_regeneration": left,
        "electrical_losses": float(np.hypot(left, regeneration)),
        "regeneration": regeneration,
        "regeneration_upper_bound": _combined([d.negative for d in drawn], own.negative),
        "positive_mechanical": positive,
        "motion_efficiency_percent": motion_efficiency(positive, float(totals.mean())),
    }


def _scatter(values: Float) -> float:
    """Standard error of the mean over the repetitions."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _combined(drawn: Sequence[Float], own: Float) -> float:
    """Uncertainty of a group's mean over the repetitions (R,), from the draws' and from its own scatter."""
    return float(np.hypot(np.std([values.mean() for values in drawn]), _scatter(own)))


def _power_at_edges(one: Observed, drive: Drive, repetitions: Sequence[Repetition]) -> float:
    """Power in W at rest where repetitions begin and end: an edge that is off moves so much energy."""
    motion = one.run.motion
    at = np.clip(np.searchsorted(motion.time, np.concatenate(edges(repetitions))), 0, len(motion.time) - 1)
    return float(supply_power(drive, bus_power(drive, one.feature[at])).mean())


def _refusal(one: Observed, drive: Drive, best: dict[str, float], spread: dict[str, float | None]) -> str:
    """Why the data do not allow the split, or nothing."""
    wide = 100 * (spread["regeneration"] or 0.0) / best["total"]
    if wide > TOO_WIDE:
        return f"regeneration is only known to ±{wide:.1f} % of the total: not told apart from electrical losses"
    used, missed = residual(one, drive)
    braking = _braking(one, drive)[used]
    seen = braking > BRAKING
    if not seen.any():
        return ""
    wrong = float(np.sum(braking[seen] * missed[seen]) / np.sum(braking[seen] ** 2))
    contradicted = abs(wrong) * best["regeneration_upper_bound"]
    if abs(wrong) > UNEXPLAINED and 100 * contradicted / best["total"] > TOO_WIDE:
        return (
            f"while braking the analyzer differs from the model by {100 * wrong:.0f} % of the braking power: "
            "the split of electrical losses and regeneration is not told"
        )
    return ""


def _braking(one: Observed, drive: Drive) -> Float:
    """Braking power on the bus (N,) W, mean over each value of the analyzer."""
    bus = bus_power(drive, one.feature)
    motion, reading = one.run.motion, one.run.reading
    sums = Accumulated(float(motion.time[0]), motion.step, np.maximum(-bus, 0.0))
    return sums.between(*windows(reading, one.offset.seconds)) / reading.step
