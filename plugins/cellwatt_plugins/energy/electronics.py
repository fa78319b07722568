"""Follows the power of the electronics, which changes as they warm up and fans start, from every rest of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import bus_power, features
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.robot import Arm

FOLLOW = 0.2
"""Weight of a new rest in the level of the electronics."""


@dataclass(frozen=True)
class Level:
    """The electronics' present power: ``drift`` W above the campaign's value.

    ``scatter`` W is the rms difference between recent rests and the level before each: its uncertainty in addition to
    that of the campaign's parameters, by ``slope`` (3 + 5 n,), the level's derivative in the order of
    ``Known.covariance``.
    """

    drift: float
    scatter: float
    slope: Float


def at_campaign(known: Known) -> Level:
    """The level before any rest: the campaign's value."""
    return Level(0.0, 0.0, np.eye(len(known.covariance))[0])


def followed(level: Level, arm: Arm, known: Known, torque: Float, power: float) -> Level:
    """Update the level by a rest of mean ``power`` W, held by the reported ``torque`` (n,) Nm, unless braked."""
    feature = features(arm, torque[None, :], np.zeros((1, arm.joints)))
    seen = power - known.drive.fixed - float(bus_power(known.drive, feature)[0])
    # The electronics may have drifted by more than the brakes draw, and back since the last rest.
    released = np.array([0.0, level.drift])
    if known.brakes and np.abs(seen - released + known.brakes).min() < np.abs(seen - released).min():
        return level
    # At rest, the electronics' power is the measured power minus that of the brakes and of holding the arm.
    shown = -brake_slope(known)
    shown[2:-1] -= feature[0]
    missed = seen - level.drift
    return Level(
        level.drift + FOLLOW * missed,
        float(np.sqrt((1 - FOLLOW) * level.scatter**2 + FOLLOW * missed**2)),
        (1 - FOLLOW) * level.slope + FOLLOW * shown,
    )


def brake_slope(known: Known) -> Float:
    """Derivative (3 + 5 n,) of the brakes' power (fixed power minus the electronics') by the parameters."""
    slope = np.zeros(len(known.covariance))
    if known.brakes_uncertainty:
        slope[:2] = -1.0, 1.0
    return slope
