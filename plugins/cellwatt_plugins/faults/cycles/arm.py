"""Model of an arm's supply power from its motion: rigid bodies, rotors, friction, windings, supply.

Torque of joint j:  τ = Y(q, q̇, q̈) π + J q̈ + (F_c tanh(q̇ / 0.004) + F_v q̇)
Power:              P = P_0 + g D,  D = Σ_j (q̇_j τ_j + c_j τ_j²),  g differs between D > 0 and D < 0
(Sabry et al., equations (1) and (13) without the absolute value: power returned by a drive lowers the supply's power.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.drive import copper_gain, drawn
from cellwatt_plugins.robot.motion import direction

USUAL_MASS = 43.0
"""Mass of an arm that carries parts of a few kilograms, kg; what a larger arm carries grows with its mass."""


class Mechanics(Protocol):
    """What is known of an arm's links: ``Body`` by a URDF, ``BareArm`` without one."""

    @property
    def joints(self) -> int:
        """Number of joints, n."""

    @property
    def levers(self) -> Float:
        """Travel (n,) that counts as 1 rad; see ``Body.levers``."""

    def regressor(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Torques (N, n, 10 n) Nm of each of the links' parameters."""


@dataclass(frozen=True)
class Motion:
    """Positions, velocities and accelerations (N, n) in rad, or m of a prismatic joint, and s."""

    q: Float
    qd: Float
    qdd: Float

    @classmethod
    def of(cls, body: Mechanics, q: Float, qd: Float, qdd: Float) -> Motion:
        """The motion of recorded positions, in which ``body.levers`` m of a prismatic joint are 1 rad."""
        return cls(q * body.levers, qd * body.levers, qdd * body.levers)


@dataclass(frozen=True)
class Parameters:
    """``link`` (10 n,) inertial parameters; ``rotor``, ``coulomb``, ``viscous`` (n,); ``copper`` (n,) W/(Nm)²; of the
    supply, ``standby`` W and the gains ``drive`` and ``regenerate``."""

    link: Float
    rotor: Float
    coulomb: Float
    viscous: Float
    copper: Float
    standby: float
    drive: float
    regenerate: float

    def packed(self) -> Float:
        """All parameters in one array."""
        tail = [self.standby, self.drive, self.regenerate]
        return np.concatenate([self.link, self.rotor, self.coulomb, self.viscous, self.copper, tail])

    @classmethod
    def unpacked(cls, values: Float, joints: int) -> Parameters:
        """The inverse of ``packed``."""
        cuts = np.cumsum([10 * joints, joints, joints, joints, joints])
        link, rotor, coulomb, viscous, copper, tail = np.split(values, cuts)
        return cls(link, rotor, coulomb, viscous, copper, float(tail[0]), float(tail[1]), float(tail[2]))


def heft(link: Float) -> float:
    """Mass of the links relative to ``USUAL_MASS``; 1 for a lighter arm, whose parts may weigh as much."""
    return max(1.0, float(link[::PER_LINK].sum()) / USUAL_MASS)


def nominal(arm: Arm) -> Parameters:
    """Return the parameters according to the robot's description."""
    return Parameters(
        link=arm.body.parameters(),
        rotor=arm.column("rotor_inertia"),
        coulomb=arm.column("coulomb_friction"),
        viscous=arm.column("viscous_friction"),
        copper=copper_gain(arm.description),
        standby=arm.description.standby_power,
        drive=1.0,
        regenerate=1.0,
    )


def friction(parameters: Parameters, qd: Float) -> Float:
    """Friction torque (N, n) Nm."""
    return np.asarray(parameters.coulomb * direction(qd) + parameters.viscous * qd)


def torque(parameters: Parameters, regressor: Float, motion: Motion) -> Float:
    """Motor torques (N, n) Nm at the joint side."""
    return np.asarray(regressor @ parameters.link + parameters.rotor * motion.qdd + friction(parameters, motion.qd))


def supply_power(parameters: Parameters, drives: Float) -> Float:
    """Power (N,) W at the supply for powers ``drives`` (N, n) W of the drives."""
    return np.asarray(parameters.standby + drawn(drives.sum(axis=1), parameters.drive, parameters.regenerate))
