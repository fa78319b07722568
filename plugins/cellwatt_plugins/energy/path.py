"""Length and speed of the flange's path, by the encoders."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.energy.recordings import Motion
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.samples import interpolated

POINTS = 200
"""Points of a repetition between which straight lines are taken: encoder noise adds nothing to such long ones."""


def path_speed(arm: Arm, motion: Motion, repetition: Repetition) -> float:
    """Mean Cartesian speed of the last joint's frame over one repetition, mm/s."""
    times = np.linspace(repetition.start, repetition.end, POINTS)
    q = interpolated(times, motion.time, motion.position)
    places = arm.forward(q)[:, -1, :3, 3]
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    return 1000.0 * length / repetition.seconds
