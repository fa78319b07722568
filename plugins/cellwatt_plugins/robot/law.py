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
