"""The energy of one production task, split as it is measured; closed and open paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt_plugins.energy.arm import Arm
from cellwatt_plugins.energy.consumers import brake_energy, motion_efficiency
from cellwatt_plugins.energy.drive import bus_power, chopper_power, features, supply_power
from cellwatt_plugins.energy.known import Known

Float = NDArray[np.float64]

GROUPS = (
    "electronics",
    "brakes",
    "stored",
    "mechanical_losses",
    "electrical_losses",
    "regeneration",
    "unexplained",
)
"""Where the energy of a task goes: together they are its total."""
SAMPLED = 0.003
"""Share of a task's energy by which torque and velocity, taken once a frame, may miss it: one standard deviation."""


@dataclass(frozen=True)
class Stretch:
    """Frames of one task, evenly spaced: (N, n) rad, rad/s, Nm as given; (N,) W."""

    step: float
    """s."""
    position: Float
    velocity: Float
    torque: Float
    power: Float


@dataclass(frozen=True)
class TaskEnergy:
    """Groups of one task, J; they add up to ``total``."""

    total: float
    electronics: float
    brakes: float
    stored: float
    """ΔE_K + ΔE_P of arm without payload: 0 where the task ends where it began."""
    mechanical_losses: float
    electrical_losses: float
    regeneration: float
    unexplained: float
    """Measured energy that is in no group; within ``uncertainty`` where all is well."""
    positive_mechanical: float
    motion_efficiency_percent: float
    uncertainty: float
    """One standard deviation of ``unexplained``."""

    def groups(self) -> dict[str, float]:
        """What adds up to ``total``, by name."""
        return {name: float(getattr(self, name)) for name in GROUPS}


def task_energy(
    arm: Arm, known: Known, stretch: Stretch, drift: float = 0.0, unsure: float = 0.0, edge: float = 0.0
) -> TaskEnergy:
    """Split one task (eqs 1 … 5, 14, 19); ``drift`` W is what the electronics now take beyond the campaign's value.

    ``unsure`` W is the uncertainty of ``drift``; ``edge`` J that of the total, by meter values that come early or late.
    """
    step, drive = stretch.step, known.drive
    seconds = step * len(stretch.power)
    feature = features(arm, stretch.torque, stretch.velocity)
    bus = bus_power(drive, feature)
    work = feature[:, : arm.joints] * drive.torque
    mechanical = float(work.sum()) * step
    stored = stored_energy(arm, stretch)
    chopper = float(chopper_power(drive, bus).sum()) * step
    total = float(stretch.power.sum()) * step
    electronics = (known.electronics + drift) * seconds
    brakes = brake_energy(known.brakes, seconds)
    said = float((supply_power(drive, bus) - drive.fixed).sum()) * step
    positive = float(np.maximum(work, 0.0).sum()) * step
    model = float(np.hypot(known.model_error, SAMPLED))
    return TaskEnergy(
        total=total,
        electronics=electronics,
        brakes=brakes,
        stored=stored,
        mechanical_losses=mechanical - stored,
        electrical_losses=said - mechanical - chopper,
        regeneration=chopper,
        unexplained=total - electronics - brakes - said,
        positive_mechanical=positive,
        motion_efficiency_percent=motion_efficiency(positive, total),
        uncertainty=float(np.linalg.norm([model * total, known.brakes_uncertainty * seconds, unsure * seconds, edge])),
    )


def stored_energy(arm: Arm, stretch: Stretch) -> float:
    """ΔE_K + ΔE_P of the arm from the first to the last frame, J."""
    model, data = arm.body.model, arm.body.model.createData()

    def at(index: int) -> float:
        q, qd = stretch.position[index], stretch.velocity[index]
        return float(pin.computePotentialEnergy(model, data, q) + pin.computeKineticEnergy(model, data, q, qd))

    return at(-1) - at(0)


def resting_power(arm: Arm, known: Known, torque: Float) -> float:
    """What holding the arm by ``torque`` (n,) Nm as given draws beyond fixed power, W."""
    return float(bus_power(known.drive, features(arm, torque[None, :], np.zeros((1, arm.joints))))[0])
