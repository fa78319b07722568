"""Findings of a campaign on an arm, read back from ``energy.json`` for the live side."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from cellwatt.errors import ModelError
from cellwatt.files import read_text
from cellwatt_plugins.energy.drive import KINDS, Drive
from cellwatt_plugins.robot import Arm

Float = NDArray[np.float64]

ALIKE = 0.03
"""s: by so much, beside their uncertainty, offsets of the analyzer's clock in one cell may differ …"""
LATEST = 0.5
"""… and its values come no later than this, s."""


@dataclass(frozen=True)
class Known:
    """An arm's drive and fixed powers, W, as ``disaggregate`` found them."""

    robot: str
    drive: Drive
    electronics: float
    brakes: float
    brakes_uncertainty: float
    model_error: float
    """Share of a task's energy by which the model may miss it, one standard deviation."""
    viscous: tuple[float, ...]
    """Nm s/rad of each joint."""
    coulomb: tuple[float, ...]
    """Nm of each joint."""
    late: float
    """s by which power comes later than the joints."""
    covariance: Float
    """(3 + 5 n, 3 + 5 n) of the electronics' power, and of fixed power, weights and ``returned`` of the drive."""


def load_known(path: Path, arm: Arm) -> Known:
    """Read ``energy.json``. Raises ``ModelError`` where it is no such file, is of another arm or of an old cellwatt."""
    try:
        found: dict[str, Any] = json.loads(read_text(path))
        if "drives" in found and "covariance" not in found:
            raise ModelError(
                f"{path}: is of an earlier cellwatt and does not say how its parameters are uncertain: "
                "run `cellwatt disaggregate` again"
            )
        known = _known(found, arm)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelError(f"{path}: is not energy.json of `cellwatt disaggregate`: {error!r}") from error
    if known.robot != arm.description.robot or len(known.viscous) != arm.joints:
        raise ModelError(f"{path}: is of robot {known.robot}, robot.yaml describes {arm.description.robot}")
    return known


def _known(found: dict[str, Any], arm: Arm) -> Known:
    fixed, drives = found["fixed"], found["drives"]
    torque, ohm, switching, eddy, hysteresis = (
        np.array([joint[key] for joint in drives])
        for key in ("torque_gain", "winding_resistance", "switching", "iron", "hysteresis")
    )
    factor = 1 / torque
    described = arm.column("winding_resistance")[: len(ohm)]
    electronics = fixed["controller"] + fixed["robot_electronics"]
    level = electronics + fixed["brakes"]
    drive = Drive(level, factor, ohm * factor**2 / described, switching * factor, eddy, hysteresis, found["returned"])
    return Known(
        robot=found["robot"],
        drive=drive,
        electronics=electronics,
        brakes=fixed["brakes"],
        brakes_uncertainty=fixed["brakes_uncertainty"],
        model_error=found["model_error_percent"] / 100,
        viscous=tuple(joint["viscous"] for joint in found["friction"]),
        coulomb=tuple(joint["coulomb"] for joint in found["friction"]),
        late=_late(found["runs"]),
        covariance=_covariance(fixed, found["covariance"], arm),
    )


def _covariance(fixed: dict[str, Any], drive: list[list[float]], arm: Arm) -> Float:
    """The electronics' power is one reading, that with the arm connected: what the controller takes of it cancels."""
    square = fixed["robot_electronics_uncertainty"] ** 2 - fixed["controller_uncertainty"] ** 2
    covariance = block_diag(max(square, 0.0), np.array(drive, np.float64))
    if covariance.shape != (3 + KINDS * arm.joints,) * 2:
        raise ValueError(f"covariance of {len(drive)} parameters, expected {2 + KINDS * arm.joints}")
    return np.asarray(covariance)


def _late(runs: list[dict[str, Any]]) -> float:
    """Offset of the analyzer's clock, s; 0 where runs do not agree on it: their files had clocks of their own."""
    offsets = np.array([run["analyzer_offset_s"] for run in runs])
    unsure = np.hypot([run["uncertainty"]["analyzer_offset_s"] for run in runs], ALIKE)
    late = float(np.average(offsets, weights=unsure**-2))
    alike = bool((np.abs(offsets - late) < 3 * unsure).all())
    return late if alike and 0 < late < LATEST else 0.0
