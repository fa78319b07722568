"""Present power of the electronics: they warm up and their fans start, and every rest shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import bus_power, features
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.robot import Arm

FOLLOW = 0.2
"""Share by which a rest moves the level of the electronics towards the power that it shows."""


@dataclass(frozen=True)
class Level:
    """The electronics' present power: ``drift`` W beyond the campaign's value.

    ``scatter`` W rms is how far the last rests were from what was followed until then: so well it is known, beside what
    it changes with the campaign's parameters, ``slope`` (3 + 5 n,) in the order of ``Known.covariance``.
    """

    drift: float
    scatter: float
    slope: Float


def at_campaign(known: Known) -> Level:
    """The level before any rest was seen: what the campaign read."""
    return Level(0.0, 0.0, np.eye(len(known.covariance))[0])


def followed(level: Level, arm: Arm, known: Known, torque: Float, power: float) -> Level:
    """The level after a rest of mean ``power`` W, held by ``torque`` (n,) Nm as given, unless its brakes are on."""
    feature = features(arm, torque[None, :], np.zeros((1, arm.joints)))
    seen = power - known.drive.fixed - float(bus_power(known.drive, feature)[0])
    if known.brakes and seen < -0.5 * known.brakes:
        return level
    # By a rest the electronics are its power less the brakes' and what holds the arm.
    shown = -brake_slope(known)
    shown[2:-1] -= feature[0]
    missed = seen - level.drift
    return Level(
        level.drift + FOLLOW * missed,
        float(np.sqrt((1 - FOLLOW) * level.scatter**2 + FOLLOW * missed**2)),
        (1 - FOLLOW) * level.slope + FOLLOW * shown,
    )


def brake_slope(known: Known) -> Float:
    """(3 + 5 n,) how the brakes' power, fixed power less the electronics', changes with the parameters."""
    slope = np.zeros(len(known.covariance))
    if known.brakes_uncertainty:
        slope[:2] = -1.0, 1.0
    return slope
