"""The simulation's law: what the nominal robot says of torque and supply power."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.rigid_body import RigidBody

Float = NDArray[np.float64]


def column(robot: RobotDescription, name: str) -> Float:
    """One number of every joint, e.g. ``coulomb_friction``: (n,)."""
    return np.array([getattr(joint, name) for joint in robot.joints], np.float64)


def nominal_torque(robot: RobotDescription, body: RigidBody, q: Float, qd: Float, qdd: Float) -> Float:
    """Motor torques (N, n) Nm at the joint side: rigid body, rotor, Coulomb and viscous friction."""
    rotor = column(robot, "rotor_inertia") * qdd
    coulomb = column(robot, "coulomb_friction") * direction(qd)
    return body.inverse_dynamics(q, qd, qdd) + rotor + coulomb + column(robot, "viscous_friction") * qd


def copper_gain(robot: RobotDescription) -> Float:
    """Heat in each winding for a torque of 1 Nm, (n,) W/Nm²: R / K²; 0 where either is unknown."""
    constant = column(robot, "torque_constant")
    resistance = column(robot, "winding_resistance")
    return np.divide(resistance, constant**2, out=np.zeros_like(constant), where=constant > 0)


def copper_loss(robot: RobotDescription, torque: Float) -> Float:
    """Heat (N, n) W in each winding: R (torque / torque constant)²; 0 where either is unknown."""
    return np.asarray(torque**2 * copper_gain(robot))


def nominal_power(robot: RobotDescription, torque: Float, qd: Float) -> Float:
    """Supply power (N,) W: standby, and what the drives take or give back, mechanical power and copper loss."""
    drives = np.sum(torque * qd + copper_loss(robot, torque), axis=1)
    passed = np.where(drives > 0, drives / robot.converter_efficiency, drives * robot.regeneration)
    return np.asarray(robot.standby_power + passed)
