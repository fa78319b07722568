"""Joint uncertainty of the energy groups of one task.

The campaign's parameters are the same for every sample of a task: their covariance is propagated linearly through the
groups' derivatives. Noise of the samples averages out. A cause that moves energy between groups, or scales all groups,
is one column, so that the groups' errors add up to that of the measured total.
"""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import Drive, bus_power, chopper_power
from cellwatt_plugins.energy.electronics import Level, brake_slope
from cellwatt_plugins.energy.known import Known

GROUPS = (
    "electronics",
    "brakes",
    "stored",
    "mechanical_losses",
    "electrical_losses",
    "regeneration",
    "unexplained",
)
"""Groups of a task's energy; they add up to its total. ``stored`` is ΔE_K + ΔE_P of the arm without payload: 0 if the
task ends in its start pose. ``unexplained`` is measured energy in no other group; in a healthy cell it is within its
uncertainty."""
ELECTRONICS, BRAKES, STORED, MECHANICAL, ELECTRICAL, REGENERATION, UNEXPLAINED = range(len(GROUPS))
TOTAL = UNEXPLAINED
"""Row of the measured total in arrays without ``unexplained``, which follows from the others."""


def group_covariance(known: Known, level: Level, feature: Float, step: float, causes: Float) -> Float:
    """Covariance (7, 7) J² of ``GROUPS`` for a task with ``feature`` (N, 5 n) at samples ``step`` s apart.

    ``causes`` (7, k) J: effects of further error causes, one standard deviation each, on the groups and total (last).
    """
    slope = group_slopes(known, level, feature, step)
    covariance = slope @ known.covariance @ slope.T + _sampled(known.drive, feature, step)
    drifting = np.zeros(len(GROUPS))
    drifting[ELECTRONICS] = level.scatter * step * len(feature)
    columns = np.column_stack([drifting, causes])
    covariance = covariance + columns @ columns.T
    return np.asarray(_LEFT @ covariance @ _LEFT.T)


def group_slopes(known: Known, level: Level, feature: Float, step: float) -> Float:
    """Derivative (7, 3 + 5 n) of each group by the campaign's parameters; the last row, of the total, is 0."""
    drive, joints = known.drive, len(known.drive.torque)
    seconds, energy = step * len(feature), feature.sum(axis=0) * step
    bus = bus_power(drive, feature)
    slope = np.zeros((len(GROUPS), len(known.covariance)))
    slope[ELECTRONICS] = level.slope * seconds
    slope[BRAKES] = brake_slope(known) * seconds
    slope[MECHANICAL, 2 : 2 + joints] = energy[:joints]
    slope[ELECTRICAL, 2 + joints : -1] = energy[joints:]
    slope[REGENERATION, 2:-1] = -(1.0 - drive.returned) * feature[bus < 0].sum(axis=0) * step
    slope[REGENERATION, -1] = np.minimum(bus, 0.0).sum() * step
    return slope


def _sampled(drive: Drive, feature: Float, step: float) -> Float:
    """Covariance (7, 7) J² due to noise, from third differences of the groups' power, in which motion cancels."""
    joints = len(drive.torque)
    weights = drive.weights()
    mechanical, electrical = feature[:, :joints] @ weights[:joints], feature[:, joints:] @ weights[joints:]
    power = np.column_stack([mechanical, electrical, chopper_power(drive, mechanical + electrical)])
    third = np.diff(power, n=3, axis=0)
    out = np.zeros((len(GROUPS), len(GROUPS)))
    if len(third):
        groups = slice(MECHANICAL, REGENERATION + 1)
        out[groups, groups] = third.T @ third / (20.0 * len(third)) * len(power) * step**2
    return out


def deviations(covariance: Float) -> dict[str, float]:
    """One standard deviation of each group, J, by name."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return {name: float(value) for name, value in zip(GROUPS, spread, strict=True)}


_LEFT = np.eye(len(GROUPS))
"""Matrix from groups and total to groups and ``unexplained``."""
_LEFT[UNEXPLAINED, :UNEXPLAINED] = -1.0
