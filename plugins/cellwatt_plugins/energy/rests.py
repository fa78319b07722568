"""Finds the rests of an arm, from its encoders alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.recordings import RobotTrace
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot.stretches import stretches

STILL: Final = 0.1
"""Time over which an arm at rest moves less than the noise, s."""
NOISY: Final = 8.0
"""Largest movement at rest, in standard deviations of the encoders' noise."""


def signal_noise(values: Float) -> float:
    """White noise of positions (rad) or velocities (rad/s) ``values`` (N, n), median over the joints."""
    return max(float(np.median(white_noise(values))), 1e-7)


def rests(motion: RobotTrace, creep: float = 0.0) -> list[tuple[int, int]]:
    """First and last sample (exclusive) of each rest: no joint moves beyond noise, or ``creep`` rad, in ``STILL`` s."""
    lag = max(1, round(STILL / motion.step))
    moved = np.abs(motion.position[lag:] - motion.position[:-lag]).max(axis=1)
    return [(a, b + lag) for a, b in stretches(moved < max(creep, NOISY * signal_noise(motion.position)))]
