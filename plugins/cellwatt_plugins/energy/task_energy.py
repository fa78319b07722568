"""Splits the measured energy of one production task by consumer, for closed and open paths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import bus_power, chopper_power, features, supply_power
from cellwatt_plugins.energy.electronics import Level
from cellwatt_plugins.energy.equations import motion_efficiency
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.energy.spread import (
    ELECTRICAL,
    GROUPS,
    MECHANICAL,
    STORED,
    TOTAL,
    UNEXPLAINED,
    group_covariance,
)
from cellwatt_plugins.robot import Arm

HELD = 0.003
"""Error of a task's energy because power values are held over frames, as a share, one standard deviation."""
MASSES = 0.03
"""Relative error of the described masses, and so of the energy of lifting them, one standard deviation."""
GRAVITY = 9.81
"""m/s²."""


@dataclass(frozen=True)
class Stretch:
    """Frames of one task, ``step`` s apart: (N, n) rad, rad/s, Nm as reported by the robot; ``power`` (N,) W."""

    step: float
    position: Float
    velocity: Float
    torque: Float
    power: Float


@dataclass(frozen=True)
class TaskEnergy:
    """Energy of one task, J, by ``GROUPS``, which add up to ``total``.

    The errors of the groups are correlated: ``covariance`` (7, 7) J².
    """

    total: float
    groups: Mapping[str, float]
    positive_mechanical: float
    motion_efficiency_percent: float
    covariance: Float

    @property
    def uncertainty(self) -> float:
        """One standard deviation of ``unexplained``, J."""
        return float(np.sqrt(self.covariance[UNEXPLAINED, UNEXPLAINED]))


def task_energy(
    arm: Arm, known: Known, stretch: Stretch, level: Level, edge: float = 0.0, meter: float = 0.0
) -> TaskEnergy:
    """Split one task (eqs 1 … 5, 14, 19); ``level`` is the electronics' present power.

    ``edge`` J is the uncertainty of the total due to early or late meter values, ``meter`` that of the meter's scale,
    as a share; one standard deviation each.
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
    electronics = (known.electronics + level.drift) * seconds
    brakes = known.brakes * seconds
    modelled = float((supply_power(drive, bus) - drive.fixed).sum()) * step
    positive = float(np.maximum(work, 0.0).sum()) * step
    losses, electrical = mechanical - stored, modelled - mechanical - chopper
    causes = np.zeros((len(GROUPS), 4))
    causes[ELECTRICAL, 0] = known.model_error * total
    # Mechanical energy that is not stored is lost.
    lifted = float(np.hypot(MASSES * stored, _payload_lifted(arm, stretch)))
    causes[[STORED, MECHANICAL], 1] = lifted, -lifted
    causes[TOTAL, 2] = np.hypot(HELD * total, edge)
    causes[:, 3] = meter * np.array([electronics, brakes, stored, losses, electrical, chopper, total])
    groups = (electronics, brakes, stored, losses, electrical, chopper, total - electronics - brakes - modelled)
    return TaskEnergy(
        total=total,
        groups=dict(zip(GROUPS, groups, strict=True)),
        positive_mechanical=positive,
        motion_efficiency_percent=motion_efficiency(positive, total),
        covariance=group_covariance(known, level, feature, step, causes),
    )


def stored_energy(arm: Arm, stretch: Stretch) -> float:
    """Change of the arm's energy ΔE_K + ΔE_P from the first to the last frame, J."""
    first, last = arm.body.energy(stretch.position[[0, -1]], stretch.velocity[[0, -1]])
    return float(last - first)


def _payload_lifted(arm: Arm, stretch: Stretch) -> float:
    """One standard deviation, J, of the stored energy of an unknown payload between none and the maximum."""
    first, last = arm.forward(stretch.position[[0, -1]])[:, -1, 2, 3]
    return float(GRAVITY * arm.description.payload * abs(last - first) / 3**0.5)


def resting_power(arm: Arm, known: Known, torque: Float) -> float:
    """Power above fixed power, W, of holding the arm with the reported ``torque`` (n,) Nm."""
    return float(bus_power(known.drive, features(arm, torque[None, :], np.zeros((1, arm.joints))))[0])
