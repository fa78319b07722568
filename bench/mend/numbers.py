"""How far the numbers of a file's joints are from the truth."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from concealed.arms import Arm

NUMBERS = {"frictionloss": "coulomb", "damping": "viscous", "armature": "rotor"}


def off(model: mujoco.MjModel, truth: Arm) -> dict[str, Any]:
    """Median and worst error, per cent of the truth, of friction loss, damping and armature; where the worst is."""
    errors, names = [], []
    for attribute, figure in NUMBERS.items():
        true = getattr(truth, figure)
        errors += (100 * np.abs(getattr(model, f"dof_{attribute}")[: truth.joints] / true - 1)).tolist()
        names += [f"{attribute} {j + 1}" for j in range(truth.joints)]
    worst = int(np.argmax(errors))
    return {"median": float(np.median(errors)), "worst": errors[worst], "where": names[worst]}
