"""Energy of a way that was never driven, from one pose to another, by the dynamic model."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.drive import bus_power, features, supply_power
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import direction

Float = NDArray[np.float64]

STEP: Final = 0.01
"""s."""
SHORTEST: Final = 0.5
"""s."""
PEAK: Final = 1.875
"""Greatest velocity of a minimum-jerk move, in distance by time."""


def way_seconds(start: Float, end: Float, fastest: float) -> float:
    """Time of a minimum-jerk move between two poses (n,) rad whose fastest joint reaches ``fastest`` rad/s."""
    return max(PEAK * float(np.abs(end - start).max()) / fastest, SHORTEST)


def way_energy(arm: Arm, known: Known, start: Float, end: Float, seconds: float) -> float:
    """Energy J beyond fixed power of a minimum-jerk move between two poses (n,) rad, without payload.

    Torque is that of the rigid bodies, rotors and friction (Flash, Hogan, 1985, for the move).
    """
    s = ((np.arange(max(2, round(seconds / STEP))) + 0.5) * STEP / seconds)[:, None]
    way = end - start
    q = start + way * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
    qdd = way * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2
    torque = arm.body.inverse_dynamics(q, qd, qdd) + arm.column("rotor_inertia") * qdd
    torque = torque + np.array(known.viscous) * qd + np.array(known.coulomb) * direction(qd)
    bus = bus_power(known.drive, features(arm, torque / known.drive.torque, qd))
    return float((supply_power(known.drive, bus) - known.drive.fixed).sum()) * STEP
