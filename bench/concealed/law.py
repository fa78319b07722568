"""The simulation's law on a given motion, with MuJoCo's inverse dynamics as the rigid body."""

from __future__ import annotations

import mujoco
import numpy as np

from concealed.arms import Arm, Array
from concealed.describe import mjcf

SIGN_WIDTH = 0.004
"""rad/s: the width of the smoothed sign in the contract's Coulomb friction."""
GRAVITY = 9.81


def gravity_of(roll: float, pitch: float) -> Array:
    """Gravity in the frame of a base that is rolled about x, then pitched about y (rad)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    base = np.array([[cp, sp * sr, sp * cr], [0, cr, -sr], [-sp, cp * sr, cp * cr]])
    return np.asarray(base.T @ np.array([0.0, 0.0, -GRAVITY]))


def inverse(model: mujoco.MjModel, data: mujoco.MjData, q: Array, v: Array, a: Array) -> Array:
    """(N, n) Nm by ``mj_inverse`` for motion (N, n) in rad, rad/s, rad/s²."""
    out = np.empty_like(q, dtype=float)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], v[i], a[i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse
    return out


class RigidBody:
    """Inverse dynamics of the links alone (no rotors, no friction).

    `payload` is (mass kg, centre of mass in the flange frame m), `gravity` in m/s² in the base's frame.
    """

    def __init__(self, arm: Arm, payload: tuple[float, Array] | None = None, gravity: Array | None = None) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(arm, 1, armature=False))
        self.data = mujoco.MjData(self.model)
        if payload is not None:
            self.model.body_mass[-1], self.model.body_ipos[-1] = payload
        if gravity is not None:
            self.model.opt.gravity[:] = gravity

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """(N, n) torque in Nm for motion (N, n) in rad, rad/s, rad/s²."""
        return inverse(self.model, self.data, q, v, a)

    def inertia(self, q: Array) -> Array:
        """(n,) diagonal of the mass matrix of the links at one pose, kg m²."""
        data = self.data
        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_forward(self.model, data)
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, full)
        return np.diag(full).copy()


def friction(arm: Arm, v: Array) -> Array:
    """Coulomb and viscous friction (…, n) in Nm at velocity v, as the contract writes it."""
    return np.asarray(arm.coulomb * np.tanh(v / SIGN_WIDTH) + arm.viscous * v)


def joint_torque(arm: Arm, q: Array, v: Array, a: Array) -> Array:
    """(N, n) torque of the simulation's law, Nm."""
    return np.asarray(RigidBody(arm).torque(q, v, a) + arm.rotor * a + friction(arm, v))
