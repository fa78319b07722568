"""Rigid-body dynamics of a URDF, for whole recordings at a time (rows: samples, columns: joints)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import copy
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt.files import read_bytes

Float = NDArray[np.float64]

PER_LINK = 10
"""Inertial parameters of a link: m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint frame's origin."""

LEAST_MASS = 1e-6
"""kg: without a mass, a link's first moment has no centre."""

TURNS = 2 * np.pi
"""rad each way that a joint without limits is taken to turn."""


class RigidBody:
    """The serial arm of a URDF with ``joints`` moving, in that order; all else is fixed."""

    def __init__(self, urdf: Path, joints: tuple[str, ...]) -> None:
        """Raises ``ConfigError`` where the URDF cannot be read or lacks a joint."""
        try:
            model = pin.buildModelFromXML(_with_one_angle_each(urdf))
        except (OSError, ET.ParseError, ValueError, RuntimeError) as error:
            raise ConfigError(f"{urdf}: cannot be read as a URDF: {error}") from error
        names = list(model.names)[1:]
        if missing := [name for name in joints if name not in names]:
            raise ConfigError(f"{urdf}: no moving joint {', '.join(missing)}; there are {', '.join(names)}")
        if others := [model.getJointId(name) for name in names if name not in joints]:
            model = pin.buildReducedModel(model, others, pin.neutral(model))
        if tuple(model.names)[1:] != joints or model.nq != len(joints):
            raise ConfigError(
                f"{urdf}: its joints come in the order {', '.join(list(model.names)[1:])}, "
                f"the description has {', '.join(joints)}: the order must be from the base, each with one angle"
            )
        self.model = model
        self.changed: Float | None = None
        """Inertial parameters (10 n,) where they are not the URDF's."""
        self._data = model.createData()

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.model.nv)

    def parameters(self) -> Float:
        """Inertial parameters of all links, (10 n,); see ``PER_LINK``."""
        return np.concatenate([self.model.inertias[i + 1].toDynamicParameters() for i in range(self.joints)])

    def with_parameters(self, parameters: Float) -> RigidBody:
        """The same kinematics with other inertial ``parameters`` (10 n,); they need not be physical one by one."""
        out = copy(self)
        out.model, out.changed = self.model.copy(), np.array(parameters, np.float64)
        for i, own in enumerate(out.changed.reshape(-1, PER_LINK), start=1):
            own[0] = own[0] if abs(own[0]) > LEAST_MASS else LEAST_MASS
            out.model.inertias[i] = pin.Inertia.FromDynamicParameters(own)
        out._data = out.model.createData()
        return out

    def inverse_dynamics(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Joint torques (N, n) Nm for ``q`` rad, ``qd`` rad/s, ``qdd`` rad/s², (N, n) each."""
        model, data, out = self.model, self._data, np.empty((len(q), self.joints))
        for i, row in enumerate(zip(q, qd, qdd, strict=True)):
            out[i] = pin.rnea(model, data, *row)
        return out

    def gravity_torque(self, q: Float) -> Float:
        """Torques (N, n) Nm that hold the arm still at ``q`` (N, n) rad."""
        return np.stack([pin.computeGeneralizedGravity(self.model, self._data, row) for row in q])

    def regressor(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Y (N, n, 10 n) with torques = Y · ``parameters()``; linear identification model (Khalil, Dombre, ch. 12)."""
        out = np.empty((len(q), self.joints, PER_LINK * self.joints))
        for i, row in enumerate(zip(q, qd, qdd, strict=True)):
            out[i] = pin.computeJointTorqueRegressor(self.model, self._data, *row)
        return out

    def own_inertia(self, q: Float) -> Float:
        """Diagonal (N, n) kg m² of the mass matrix at ``q`` (N, n) rad: what each joint feels alone."""
        return np.stack([np.diag(pin.crba(self.model, self._data, row)) for row in q])

    def inertia_of(self, q: Float, joint: int) -> Float:
        """Column (N, n) kg m² of the mass matrix: what each joint needs when ``joint`` (0-based) accelerates."""
        model, data = self.model, self._data
        return np.stack([pin.crba(model, data, row)[:, joint] for row in q])

    def gravity_slope(self, q: Float, joint: int) -> Float:
        """How gravity's torques (N, n) change with the angle of ``joint`` (0-based) at ``q`` (N, n) rad, Nm/rad."""
        model, data = self.model, self._data
        return np.stack([pin.computeGeneralizedGravityDerivatives(model, data, row)[:, joint] for row in q])

    def tilt_torque(self, q: Float, gravity: Float) -> Float:
        """Torques (N, n) Nm that ``gravity`` (3,) m/s² in the base frame, instead of the vertical one, would need."""
        return self.under(gravity).gravity_torque(q)

    def under(self, gravity: Float) -> RigidBody:
        """The same arm under another ``gravity`` (3,) m/s² in the base frame."""
        other = copy(self)
        other.model = self.model.copy()
        other.model.gravity = pin.Motion(np.asarray(gravity, np.float64), np.zeros(3))
        other._data = other.model.createData()
        return other

    def poses(self, q: Float) -> tuple[Float, Float]:
        """Frames (N, n, 4, 4) of the joints in the base's, and their axes (N, n, 3) there, at ``q`` (N, n) rad."""
        model, data = self.model, self._data
        frames, axes = np.empty((len(q), self.joints, 4, 4)), np.empty((len(q), self.joints, 3))
        for k, row in enumerate(q):
            columns = pin.computeJointJacobians(model, data, row)
            turns = np.linalg.norm(columns[3:], axis=0) > 0.5
            axes[k] = np.where(turns, columns[3:], columns[:3]).T
            frames[k] = [data.oMi[i + 1].homogeneous for i in range(self.joints)]
        return frames, axes


def _with_one_angle_each(urdf: Path) -> str:
    """The URDF with its ``continuous`` joints, and those without limits, as ones that turn ``TURNS`` each way."""
    root = ET.fromstring(read_bytes(urdf))
    for joint in root.iter("joint"):
        limit = joint.find("limit")
        if joint.get("type") == "continuous" or (joint.get("type") == "revolute" and not _has_room(limit)):
            joint.set("type", "revolute")
            limit = ET.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
            limit.set("lower", str(-TURNS))
            limit.set("upper", str(TURNS))
    return ET.tostring(root, encoding="unicode")


def _has_room(limit: ET.Element | None) -> bool:
    return limit is not None and float(limit.get("lower", 0)) < float(limit.get("upper", 0))
