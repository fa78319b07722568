"""What a campaign found of an arm, read back from ``energy.json`` for the live side."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.errors import ModelError
from cellwatt_plugins.energy.arm import Arm
from cellwatt_plugins.energy.drive import Drive


@dataclass(frozen=True)
class Known:
    """An arm's drive and fixed powers, W, as ``disaggregate`` found them."""

    robot: str
    drive: Drive
    electronics: float
    electronics_uncertainty: float
    brakes: float
    brakes_uncertainty: float
    model_error: float
    """Share of a task's energy by which the model may miss it, one standard deviation."""
    viscous: tuple[float, ...]
    """Nm s/rad of each joint."""


def load_known(path: Path, arm: Arm) -> Known:
    """Read ``energy.json``. Raises ``ModelError`` where it is no such file or is of another arm."""
    try:
        found: dict[str, Any] = json.loads(path.read_text())
        known = _known(found, arm)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{path}: is not energy.json of `cellwatt disaggregate`: {error!r}") from error
    if known.robot != arm.description.robot or len(known.viscous) != arm.joints:
        raise ModelError(f"{path}: is of robot {known.robot}, robot.yaml describes {arm.description.robot}")
    return known


def _known(found: dict[str, Any], arm: Arm) -> Known:
    fixed, drives = found["fixed"], found["drives"]
    torque, ohm, switching, iron = (
        np.array([joint[key] for joint in drives]) for key in ("torque_gain", "winding_resistance", "switching", "iron")
    )
    factor = 1 / torque
    described = arm.column("winding_resistance")[: len(ohm)]
    electronics = fixed["controller"] + fixed["robot_electronics"]
    level = electronics + fixed["brakes"]
    drive = Drive(level, factor, ohm * factor**2 / described, switching * factor, iron, found["returned"])
    unsure = float(np.hypot(fixed["controller_uncertainty"], fixed["robot_electronics_uncertainty"]))
    return Known(
        robot=found["robot"],
        drive=drive,
        electronics=electronics,
        electronics_uncertainty=unsure,
        brakes=fixed["brakes"],
        brakes_uncertainty=fixed["brakes_uncertainty"],
        model_error=found["model_error_percent"] / 100,
        viscous=tuple(joint["viscous"] for joint in found["friction"]),
    )
