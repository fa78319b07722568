"""Findings of a campaign on an arm, read from ``energy.json`` for the live stage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from cellwatt.arrays import Float
from cellwatt.config import read_settings
from cellwatt.errors import ModelError
from cellwatt_plugins.energy.drive import KINDS, Drive
from cellwatt_plugins.energy.findings import Findings, Fixed, RunEnergy
from cellwatt_plugins.robot import Arm

ALIKE = 0.03
"""Variation of the analyzer's clock offset in one cell beyond its uncertainty, s …"""
LATEST = 0.5
"""… and largest delay of the analyzer's values, s."""


@dataclass(frozen=True)
class Known:
    """An arm's drive and fixed powers, W, from ``disaggregate``.

    ``model_error`` is one standard deviation of the model's error as a share of a task's energy, ``viscous`` (n,) Nm
    s/rad, ``late`` s the delay of power relative to the joints, ``covariance`` (3 + 5 n, 3 + 5 n) that of the
    electronics' power, and of the drive's fixed power, weights and ``returned``.
    """

    robot: str
    drive: Drive
    electronics: float
    brakes: float
    brakes_uncertainty: float
    model_error: float
    viscous: tuple[float, ...]
    late: float
    covariance: Float


def load_known(path: Path, arm: Arm) -> Known:
    """Read ``energy.json``. Raises ``ModelError`` if its content, arm or version of cellwatt does not match."""
    try:
        found = read_settings(path, Findings, refusal=ModelError, computed=True)
    except ModelError as error:
        raise ModelError(f"{error}; if it is of an earlier cellwatt, run `cellwatt disaggregate` again") from error
    if found.robot != arm.description.robot or len(found.friction) != arm.joints:
        raise ModelError(f"{path}: is of robot {found.robot}, robot.yaml describes {arm.description.robot}")
    try:
        return _known(found, arm)
    except ValueError as error:
        raise ModelError(f"{path}: {error}") from error


def _known(found: Findings, arm: Arm) -> Known:
    fixed = found.fixed
    torque, ohm, switching, iron, hysteresis = (
        np.array([getattr(joint, key) for joint in found.drives])
        for key in ("torque_gain", "winding_resistance", "switching", "iron", "hysteresis")
    )
    factor = 1 / torque
    described = arm.column("winding_resistance")[: len(ohm)]
    level = fixed.electronics + fixed.brakes
    drive = Drive(level, factor, ohm * factor**2 / described, switching * factor, iron, hysteresis, found.returned)
    return Known(
        robot=found.robot,
        drive=drive,
        electronics=fixed.electronics,
        brakes=fixed.brakes,
        brakes_uncertainty=fixed.brakes_uncertainty,
        model_error=found.model_error_percent / 100,
        viscous=tuple(joint.viscous for joint in found.friction),
        late=_late(found.runs),
        covariance=_covariance(fixed, found.covariance, arm),
    )


def _covariance(fixed: Fixed, drive: tuple[tuple[float, ...], ...], arm: Arm) -> Float:
    """Covariance with the electronics' power first; its variance is that of the connected arm's power alone, as the
    controller's cancels."""
    square = fixed.robot_electronics_uncertainty**2 - fixed.controller_uncertainty**2
    covariance = block_diag(np.array([max(square, 0.0)]), np.array(drive, np.float64))
    if covariance.shape != (3 + KINDS * arm.joints,) * 2:
        raise ValueError(f"covariance of {len(drive)} parameters, expected {2 + KINDS * arm.joints}")
    return np.asarray(covariance)


def _late(runs: tuple[RunEnergy, ...]) -> float:
    """Delay of the analyzer's values, s; 0 if the runs disagree, because their files had separate clocks."""
    offsets = np.array([run.analyzer_offset_s for run in runs])
    unsure = np.hypot([run.uncertainty["analyzer_offset_s"] or 0.0 for run in runs], ALIKE)
    late = float(np.average(offsets, weights=unsure**-2))
    alike = bool((np.abs(offsets - late) < 3 * unsure).all())
    return late if alike and 0 < late < LATEST else 0.0
