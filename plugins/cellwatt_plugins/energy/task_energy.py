"""The energy of one production task, split as it is measured; closed and open paths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import bus_power, chopper_power, features, supply_power
from cellwatt_plugins.energy.electronics import Level, at_campaign
from cellwatt_plugins.energy.equations import brake_energy, motion_efficiency
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.energy.spread import (
    ELECTRICAL,
    GROUPS,
    MECHANICAL,
    STORED,
    TOTAL,
    UNEXPLAINED,
    deviations,
    group_covariance,
)
from cellwatt_plugins.robot import Arm

HELD = 0.003
"""Share of a task's energy by which power that is held on the frames may miss it: one standard deviation."""
MASSES = 0.03
"""Share by which the described masses, and so what a path lifted, may be off."""
GRAVITY = 9.81
"""m/s²."""


@dataclass(frozen=True)
class Stretch:
    """Frames of one task, ``step`` s apart: (N, n) rad, rad/s, Nm as given; (N,) W."""

    step: float
    position: Float
    velocity: Float
    torque: Float
    power: Float


@dataclass(frozen=True)
class TaskEnergy:
    """Energy of one task, J: ``groups`` are those of ``GROUPS``, which add up to ``total``.

    Errors of the groups go together: ``covariance`` (7, 7) J².
    """

    total: float
    groups: Mapping[str, float]
    positive_mechanical: float
    motion_efficiency_percent: float
    covariance: Float

    def group_uncertainty(self) -> dict[str, float]:
        """One standard deviation of each group, J."""
        return deviations(self.covariance)

    @property
    def uncertainty(self) -> float:
        """One standard deviation of ``unexplained``."""
        return float(np.sqrt(self.covariance[UNEXPLAINED, UNEXPLAINED]))


def task_energy(
    arm: Arm, known: Known, stretch: Stretch, level: Level | None = None, edge: float = 0.0, meter: float = 0.0
) -> TaskEnergy:
    """Split one task (eqs 1 … 5, 14, 19); ``level`` is what the electronics draw now, else as in the campaign.

    ``edge`` J is the uncertainty of the total by meter values that come early or late, ``meter`` that of the meter's
    factor, as a share; one standard deviation each.
    """
    level = at_campaign(known) if level is None else level
    step, drive = stretch.step, known.drive
    seconds = step * len(stretch.power)
    feature = features(arm, stretch.torque, stretch.velocity)
    bus = bus_power(drive, feature)
    work = feature[:, : arm.joints] * drive.torque
    mechanical = float(work.sum()) * step
    stored = stored_energy(arm, stretch)
    chopper = float(chopper_power(drive, bus).sum()) * step
    total = float(stretch.power.sum()) * step
    electronics = (known.electronics + level.drift) * seconds
    brakes = brake_energy(known.brakes, seconds)
    said = float((supply_power(drive, bus) - drive.fixed).sum()) * step
    positive = float(np.maximum(work, 0.0).sum()) * step
    losses, electrical = mechanical - stored, said - mechanical - chopper
    causes = np.zeros((len(GROUPS), 4))
    causes[ELECTRICAL, 0] = known.model_error * total
    # What is not stored was lost on the way.
    lifted = float(np.hypot(MASSES * stored, _payload_lifted(arm, stretch)))
    causes[[STORED, MECHANICAL], 1] = lifted, -lifted
    causes[TOTAL, 2] = np.hypot(HELD * total, edge)
    causes[:, 3] = meter * np.array([electronics, brakes, stored, losses, electrical, chopper, total])
    groups = (electronics, brakes, stored, losses, electrical, chopper, total - electronics - brakes - said)
    return TaskEnergy(
        total=total,
        groups=dict(zip(GROUPS, groups, strict=True)),
        positive_mechanical=positive,
        motion_efficiency_percent=motion_efficiency(positive, total),
        covariance=group_covariance(known, level, feature, step, causes),
    )


def stored_energy(arm: Arm, stretch: Stretch) -> float:
    """ΔE_K + ΔE_P of the arm from the first to the last frame, J."""
    first, last = arm.body.energy(stretch.position[[0, -1]], stretch.velocity[[0, -1]])
    return float(last - first)


def _payload_lifted(arm: Arm, stretch: Stretch) -> float:
    """One standard deviation, J, of what a payload between none and the maximum adds to the stored energy."""
    first, last = arm.forward(stretch.position[[0, -1]])[:, -1, 2, 3]
    return float(GRAVITY * arm.description.payload * abs(last - first) / 3**0.5)


def resting_power(arm: Arm, known: Known, torque: Float) -> float:
    """Power beyond fixed power in W that holding the arm by ``torque`` (n,) Nm as given draws."""
    return float(bus_power(known.drive, features(arm, torque[None, :], np.zeros((1, arm.joints))))[0])
