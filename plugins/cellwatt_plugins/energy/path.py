"""Length and speed of the flange's path, by the encoders."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt_plugins.energy.arm import Arm
from cellwatt_plugins.energy.recordings import Motion
from cellwatt_plugins.energy.repetitions import Repetition

Float = NDArray[np.float64]

POINTS = 200
"""Points of a repetition between which straight lines are taken: encoder noise adds nothing to such long ones."""


def path_speed(arm: Arm, motion: Motion, repetition: Repetition) -> float:
    """Mean Cartesian speed of the last joint's frame over one repetition, mm/s."""
    times = np.linspace(repetition.start, repetition.end, POINTS)
    q = np.stack([np.interp(times, motion.time, column) for column in motion.position.T], axis=1)
    model, data = arm.body.model, arm.body.model.createData()
    places = []
    for row in q:
        pin.forwardKinematics(model, data, row)
        places.append(np.array(data.oMi[model.njoints - 1].translation))
    length = float(np.linalg.norm(np.diff(np.array(places), axis=0), axis=1).sum())
    return 1000.0 * length / repetition.seconds
