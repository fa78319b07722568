"""Computes the consumer groups of one run and their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import Drive, bus_power, chopper_power, supply_power
from cellwatt_plugins.energy.equations import electrical_losses, motion_efficiency
from cellwatt_plugins.energy.findings import Fixed, RunEnergy
from cellwatt_plugins.energy.identify import Observed
from cellwatt_plugins.robot import Arm

TOO_WIDE = 1.0
"""Largest uncertainty of regeneration that is reported, percent of the total."""
BRAKING = 1.0
"""Smallest braking power on the bus, W, with which an analyzer value is used to check the split."""
UNEXPLAINED = 0.2
"""Largest difference between analyzer and model while braking, as a share of the braking power, for a valid split."""


def edges(one: Observed) -> tuple[Float, Float]:
    """Starts and ends (R,) s of the repetitions, robot's clock."""
    return np.array([r.start for r in one.repetitions]), np.array([r.end for r in one.repetitions])


def shared(one: Observed) -> Float:
    """Overlap (R, M) s of each repetition with the window of each value of the analyzer."""
    (starts, ends), (low, high) = edges(one), one.windows
    return np.asarray(np.maximum(np.minimum(high, ends[:, None]) - np.maximum(low, starts[:, None]), 0.0))


def mechanical(one: Observed, drive: Drive) -> dict[str, Float]:
    """Groups (R,) J per repetition that do not depend on the analyzer's values (eqs 4, 5, 10, 11, 18)."""
    n = len(drive.torque)
    power = one.feature[:, :n] * drive.torque
    chopper = chopper_power(drive, bus_power(drive, one.feature))
    columns = np.column_stack([power, np.maximum(power, 0.0).sum(axis=1), np.maximum(-power, 0.0).sum(axis=1), chopper])
    energy = one.integral(columns).between(*edges(one))
    return {
        "mechanical_losses": energy[:, :n].sum(axis=1),
        "positive_mechanical": energy[:, n],
        "regeneration_upper_bound": energy[:, n + 1],
        "regeneration": energy[:, n + 2],
    }


def total_energy(one: Observed, drive: Drive) -> Float:
    """Measured energy (R,) J of each repetition.

    The analyzer's windows do not begin and end with the repetitions: within a window, energy is distributed according
    to the model, and the residual of the model is distributed evenly.
    """
    return np.asarray(one.modelled(drive).between(*edges(one)) + shared(one) @ one.residual(drive))


@dataclass(frozen=True)
class Learnt:
    """Results of all runs of an arm: fixed power, its drive, and random ``draws`` of the drive by its uncertainty."""

    arm: Arm
    fixed: Fixed
    drive: Drive
    draws: Sequence[Drive]


def run_energy(one: Observed, learnt: Learnt) -> RunEnergy:
    """Groups of one run as means over its repetitions (eqs 4, 5, 9 … 14, 17 … 19)."""
    best, spread, notes = _groups(one, learnt), _uncertainty(one, learnt), list(one.notes)
    if best["mechanical_losses"] < 0:
        notes.append(
            f"mechanical losses of {best['mechanical_losses']:.1f} J measured, which is impossible: reported as 0; "
            "the torque error is larger than the fit can correct"
        )
        for name in ("electrical_losses_with_regeneration", "electrical_losses"):
            best[name] += best["mechanical_losses"]
        best["mechanical_losses"] = 0.0
    reason = _refusal(one, learnt.drive, best, spread)
    found = RunEnergy(
        run=one.run.name,
        speed_mm_s=one.run.speed,
        payload_kg=one.run.payload,
        repetitions=len(one.repetitions),
        analyzer_offset_s=one.offset.seconds,
        path_speed_mm_s=one.repetitions[0].path_speed(learnt.arm, one.run.motion),
        uncertainty={**spread, "analyzer_offset_s": one.offset.uncertainty},
        notes=(*notes, reason) if reason else tuple(notes),
        **best,
    )
    return replace(found, electrical_losses=None, regeneration=None) if reason else found


def _groups(one: Observed, learnt: Learnt) -> dict[str, float]:
    drive, fixed = learnt.drive, learnt.fixed
    seconds = float(np.mean([repetition.seconds for repetition in one.repetitions]))
    moved = {group: float(each.mean()) for group, each in mechanical(one, drive).items()}
    total = float(total_energy(one, drive).mean())
    electronics, brakes = fixed.electronics * seconds, fixed.brakes * seconds
    electrical = electrical_losses(total, electronics, brakes, moved["mechanical_losses"])
    return {
        "seconds": seconds,
        "total": total,
        "electronics": electronics,
        "brakes": brakes,
        "electrical_losses_with_regeneration": electrical,
        "electrical_losses": electrical - moved["regeneration"],
        "motion_efficiency_percent": motion_efficiency(moved["positive_mechanical"], total),
        **moved,
    }


def _uncertainty(one: Observed, learnt: Learnt) -> dict[str, float | None]:
    """One standard deviation of each group: parameters (draws), repetitions (their scatter), fixed power, edges."""
    fixed, drive = learnt.fixed, learnt.drive
    drawn = [mechanical(one, draw) for draw in learnt.draws]
    own = mechanical(one, drive)
    moved = {group: _combined([each[group] for each in drawn], values) for group, values in own.items()}
    totals = total_energy(one, drive)
    each = np.array([r.seconds for r in one.repetitions])
    seconds, edge = float(each.mean()), float(np.mean([r.uncertainty for r in one.repetitions]))
    power_e = float(np.hypot(fixed.controller_uncertainty, fixed.robot_electronics_uncertainty))
    rest, at_edges = fixed.electronics + fixed.brakes, _power_at_edges(one, drive)
    # Edges change total, electronics and brakes equally, except for the power that holds the arm at the edges.
    by_power = float(np.hypot(power_e, fixed.brakes_uncertainty)) * seconds
    scatter = _scatter(totals - rest * each - own["mechanical_losses"])
    remainder = float(np.linalg.norm([by_power, edge * (at_edges - rest), moved["mechanical_losses"], scatter]))
    return {
        "seconds": edge,
        "total": float(np.hypot(_scatter(totals), edge * at_edges)),
        "electronics": float(np.hypot(power_e * seconds, edge * fixed.electronics)),
        "brakes": float(np.hypot(fixed.brakes_uncertainty * seconds, edge * fixed.brakes)),
        "electrical_losses_with_regeneration": remainder,
        "electrical_losses": float(np.hypot(remainder, moved["regeneration"])),
        "motion_efficiency_percent": motion_efficiency(moved["positive_mechanical"], float(totals.mean())),
        **moved,
    }


def _scatter(values: Float) -> float:
    """Standard error of the mean over the repetitions."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _combined(drawn: Sequence[Float], own: Float) -> float:
    """Uncertainty of a group's mean over the repetitions (R,), from the draws and from its scatter."""
    return float(np.hypot(np.std([values.mean() for values in drawn]), _scatter(own)))


def _power_at_edges(one: Observed, drive: Drive) -> float:
    """Mean power at the starts and ends of the repetitions, W: the energy error per second of edge error."""
    motion = one.run.motion
    at = np.clip(np.searchsorted(motion.time, np.concatenate(edges(one))), 0, len(motion.time) - 1)
    return float(supply_power(drive, bus_power(drive, one.feature[at])).mean())


def _refusal(one: Observed, drive: Drive, best: dict[str, float], spread: dict[str, float | None]) -> str:
    """Reason why the data do not allow the split of electrical losses and regeneration; empty if they do."""
    wide = 100 * (spread["regeneration"] or 0.0) / best["total"]
    if wide > TOO_WIDE:
        return f"regeneration is only known to ±{wide:.1f} % of the total: not separated from electrical losses"
    missed = one.residual(drive)
    braking = one.means(one.integral(np.maximum(-bus_power(drive, one.feature), 0.0)))
    seen = braking > BRAKING
    if not seen.any():
        return ""
    wrong = float(np.sum(braking[seen] * missed[seen]) / np.sum(braking[seen] ** 2))
    contradicted = abs(wrong) * best["regeneration_upper_bound"]
    if abs(wrong) > UNEXPLAINED and 100 * contradicted / best["total"] > TOO_WIDE:
        return (
            f"while braking the analyzer differs from the model by {100 * wrong:.0f} % of the braking power: "
            "the split of electrical losses and regeneration is not reported"
        )
    return ""
