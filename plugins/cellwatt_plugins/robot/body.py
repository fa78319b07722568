"""Kinematics and rigid-body dynamics of a URDF through Pinocchio, for whole recordings at a time."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.files import read_bytes
from cellwatt_plugins.robot.mjcf import is_mjcf, urdf_of
from cellwatt_plugins.travel import LEVER

PER_LINK = 10
"""Inertial parameters of a link: m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint frame's origin."""

LEAST_MASS = 1e-6
"""Smallest mass in kg: the centre of mass is the first moment divided by the mass."""

NO_MASS, NO_LENGTH = 1e-3, 0.02
"""Mass (kg) and length (m) up to which a link between two joints is where their axes meet, not a casting."""

INERTIAL = ("value", "xyz", "rpy", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Attributes of ``<inertial>`` in a URDF that are numbers."""

TURNS = 2 * np.pi
"""Range in rad, each way from 0, of a joint without limits."""


@dataclass(frozen=True)
class Solid:
    """A ``shape`` of coal on a ``link`` (0: the base), with its ``placement`` (4, 4) m in the link's frame."""

    link: int
    placement: Float
    shape: Any


class Body:
    """Kinematics and dynamics of a serial arm; its n ``joints`` have one angle (or distance, m) each, others are fixed.

    Arrays have one row a sample and one column a joint. Prismatic joints have m, N and kg instead of rad, Nm and kg m².
    """

    def __init__(self, urdf: Path, joints: tuple[str, ...]) -> None:
        """Raise ``ConfigError`` if the URDF cannot be read, lacks a joint or has the joints in another order."""
        _, model = read_urdf(urdf, joints)
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
        self.names = joints
        self.changed: Float | None = None
        """Inertial parameters (10 n,) if they differ from the URDF's, else None."""
        self._use(model)

    def _use(self, model: Any) -> None:
        self._model, self._data = model, model.createData()

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.names)

    def without_mass(self) -> tuple[str, ...]:
        """Names of the links whose mass is missing.

        A link of no length, as between the axes of a wrist, and the flange may lack a mass, unless every link lacks it.
        """
        heavy = np.array([self._model.inertias[i + 1].mass > NO_MASS for i in range(self.joints)])
        long = np.linalg.norm(self.placements[1:, :3, 3], axis=1) > NO_LENGTH
        missing = ~heavy & np.append(long, False) if heavy.any() else ~heavy
        names: dict[int, str] = {}
        for frame in self._model.frames.tolist():
            if frame.type == pin.FrameType.BODY:
                names.setdefault(frame.parentJoint, frame.name)
        return tuple(names[int(i) + 1] for i in np.flatnonzero(missing))

    @property
    def limits(self) -> Float:
        """Lowest and highest position (n, 2) rad in the URDF."""
        return np.column_stack([self._model.lowerPositionLimit, self._model.upperPositionLimit])

    @property
    def velocity_limits(self) -> Float:
        """Greatest velocity (n,) rad/s in the URDF; infinite or 0 if the URDF has none."""
        return np.array(self._model.velocityLimit)

    @property
    def gravity_field(self) -> Float:
        """Acceleration of gravity (3,) m/s² in the base's frame."""
        return np.array(self._model.gravity.linear)

    @property
    def placements(self) -> Float:
        """Frame (n, 4, 4) m of each joint in the frame of the previous joint, at position 0."""
        return np.stack([self._model.jointPlacements[i + 1].homogeneous for i in range(self.joints)])

    @cached_property
    def turns(self) -> NDArray[np.bool_]:
        """(n,) true where a joint is revolute, false where it is prismatic."""
        return np.asarray(np.linalg.norm(self._subspaces[:, 3:], axis=1) > 0.5)

    @property
    def slides(self) -> list[int]:
        """Prismatic joints (0-based)."""
        return np.flatnonzero(~self.turns).tolist()

    @cached_property
    def levers(self) -> Float:
        """(n,) travel that counts as 1 rad: 1 rad of a revolute joint, ``LEVER`` m of a prismatic one."""
        return np.where(self.turns, 1.0, LEVER)

    @cached_property
    def axes(self) -> Float:
        """Unit vector (n, 3) of each joint's axis in its own frame."""
        return np.where(self.turns[:, None], self._subspaces[:, 3:], self._subspaces[:, :3])

    @cached_property
    def _subspaces(self) -> Float:
        """Velocity (n, 6), linear then angular, of each joint at 1 rad/s."""
        out = np.empty((self.joints, 6))
        for i in range(self.joints):
            joint = self._model.joints[i + 1]
            data = joint.createData()
            joint.calc(data, np.zeros(1))
            out[i] = np.asarray(data.S).reshape(6)
        return out

    def parameters(self) -> Float:
        """Inertial parameters of all links, (10 n,); see ``PER_LINK``."""
        return np.concatenate([self._model.inertias[i + 1].toDynamicParameters() for i in range(self.joints)])

    def with_parameters(self, parameters: Float) -> Body:
        """The same kinematics with other inertial ``parameters`` (10 n,); a single link's need not be physical."""
        out, model = copy(self), self._model.copy()
        out.changed = np.array(parameters, np.float64)
        for i, own in enumerate(out.changed.reshape(-1, PER_LINK), start=1):
            own[0] = own[0] if abs(own[0]) > LEAST_MASS else LEAST_MASS
            model.inertias[i] = pin.Inertia.FromDynamicParameters(own)
        out._use(model)
        return out

    def with_gravity(self, field: Float) -> Body:
        """The same arm in another gravity ``field`` (3,) m/s² in the base's frame."""
        out, model = copy(self), self._model.copy()
        model.gravity = pin.Motion(np.asarray(field, np.float64), np.zeros(3))
        out._use(model)
        return out

    def inverse_dynamics(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Torques (N, n) Nm that the links need to move: ``q`` rad, ``qd`` rad/s, ``qdd`` rad/s², (N, n) each.

        Recursive Newton–Euler; Featherstone, Rigid Body Dynamics Algorithms (2008), 5.3.
        """
        return self._rows(pin.rnea, (self.joints,), q, qd, qdd)

    def gravity(self, q: Float) -> Float:
        """Torques G (N, n) Nm that hold the arm still at ``q`` (N, n) rad."""
        return self._rows(pin.computeGeneralizedGravity, (self.joints,), q)

    def gravity_slope(self, q: Float) -> Float:
        """Derivatives ∂G/∂q (N, n, n) Nm/rad of the holding torques at ``q`` (N, n) rad; the last axis is the joint of
        q."""
        return self._rows(pin.computeGeneralizedGravityDerivatives, (self.joints, self.joints), q)

    def mass_matrix(self, q: Float) -> Float:
        """Mass matrices M (N, n, n) kg m² at ``q`` (N, n) rad; Featherstone (2008), 6.2."""
        return self._rows(pin.crba, (self.joints, self.joints), q)

    def regressor(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Y (N, n, 10 n) with ``inverse_dynamics`` = Y · ``parameters()``.

        Linear identification model; Khalil, Dombre, Modeling, Identification and Control of Robots (2002), ch. 12.
        """
        return self._rows(pin.computeJointTorqueRegressor, (self.joints, PER_LINK * self.joints), q, qd, qdd)

    def energy(self, q: Float, qd: Float) -> Float:
        """Kinetic and potential energy (N,) J of the links at ``q`` rad and ``qd`` rad/s, (N, n) each."""
        return self._rows(pin.computePotentialEnergy, (), q) + self._rows(pin.computeKineticEnergy, (), q, qd)

    def forward(self, q: Float) -> Float:
        """Frames (N, n, 4, 4) m of the joints in the base's frame at ``q`` (N, n) rad: forward kinematics."""

        def frames(model: Any, data: Any, row: Float) -> list[Float]:
            pin.forwardKinematics(model, data, row)
            return [data.oMi[i + 1].homogeneous for i in range(self.joints)]

        return self._rows(frames, (self.joints, 4, 4), q)

    def distances(self, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]]) -> Callable[[Float], Float]:
        """Return a function of positions ``q`` (N, n) rad that gives the distances (N, P) m of ``pairs`` of ``solids``.

        A distance is negative if the two solids overlap. Coal computes one pose at a time.
        """
        geometry = pin.GeometryModel()
        for i, solid in enumerate(solids):
            place = pin.SE3(solid.placement)
            geometry.addGeometryObject(pin.GeometryObject(str(i), solid.link, place, solid.shape))
        for pair in pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        found = geometry.createData()

        def apart(model: Any, data: Any, row: Float) -> list[float]:
            pin.computeDistances(model, data, geometry, found, row)
            return [result.min_distance for result in found.distanceResults]

        return lambda q: self._rows(apart, (len(pairs),), q)

    def _rows(self, algorithm: Callable[..., Any], shape: tuple[int, ...], *given: Float) -> Float:
        """Results (N, *shape) of a Pinocchio ``algorithm``, called once for each row of the ``given`` arrays."""
        out = np.empty((len(given[0]), *shape))
        for i, row in enumerate(zip(*given, strict=True)):
            out[i] = algorithm(self._model, self._data, *row)
        return out


def read_urdf(path: Path, joints: Sequence[str] = ()) -> tuple[ET.Element, Any]:
    """XML of ``with_one_angle_each``, and Pinocchio's model of it; ``joints`` as in ``urdf_bytes``.

    Raises ``ConfigError`` if it cannot be read.
    """
    try:
        text = with_one_angle_each(urdf_bytes(path, joints))
        return ET.fromstring(text), pin.buildModelFromXML(text)
    except (OSError, ET.ParseError, ValueError, RuntimeError) as error:
        raise ConfigError(f"{path}: cannot be read as a URDF: {error}") from error


def urdf_bytes(path: Path, joints: Sequence[str]) -> bytes:
    """The URDF of an arm with these ``joints``: the file's own text, or a URDF generated from a MuJoCo file.

    Raises ``ConfigError`` where MuJoCo cannot read the file, and ``OSError`` where a URDF cannot be read.
    """
    return urdf_of(path, joints).encode() if is_mjcf(path) else read_bytes(path).lstrip()


def with_one_angle_each(urdf: bytes) -> str:
    """The URDF with each ``continuous`` joint, and each joint without limits, as a revolute one of ±``TURNS``.

    Raises ``ValueError`` for what Pinocchio would leave out without a word: xacro, and numbers of masses that are none.
    """
    root = ET.fromstring(urdf)
    for part in root:
        if any("xacro" in each.tag or "${" in "".join(each.attrib.values()) for each in part.iter()):
            raise ValueError(f"{part.tag} {part.get('name', '')!r} is xacro: convert it first (xacro FILE > arm.urdf)")
        texts = (
            each.get(key, "") for inertial in part.iter("inertial") for each in inertial.iter() for key in INERTIAL
        )
        if not np.isfinite([float(number) for text in texts for number in text.split()]).all():
            raise ValueError(f"{part.tag} {part.get('name', '')!r} has an inertia that is not finite")
    for stated in root.iter("limit"):
        for key in ("effort", "velocity"):
            stated.set(key, stated.get(key, "0"))
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
