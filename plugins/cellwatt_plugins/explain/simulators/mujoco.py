"""A user's arm in MuJoCo: the torque of a motion according to the arm's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.robot.mjcf import compiled, library, scalar_types
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.servo.law import actuator_of
from cellwatt_plugins.robot.units import unit_at

LEFT_OUT = ("mjDSBL_CONTACT", "mjDSBL_LIMIT", "mjDSBL_EQUALITY", "mjDSBL_FRICTIONLOSS")
"""Contributions switched off in MuJoCo: those that are no motor torque, and dry friction, which is added separately."""


@dataclass(frozen=True)
class Actuators:
    """Actuators of n joints, among all ``count`` of a file, in whose order MuJoCo's ``ctrl`` and forces are."""

    count: int
    numbers: NDArray[np.intp]
    """(n,) number of the one actuator of each joint; -1 without one."""
    gears: Float
    """(n,) Nm at the joint per unit of the actuator's force; NaN without an actuator."""
    gains: Float
    """(n,) Nm at the joint per unit of control; NaN where the control is not a torque."""


@dataclass(frozen=True)
class Simulator:
    """An arm of n joints in MuJoCo."""

    path: Path
    model: Any
    """``mujoco.MjModel``."""
    joints: tuple[str, ...]
    """Names of the joints in the file, from the base."""
    notes: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices of the joints in ``qpos`` and in ``qvel``, (n,) each."""
        found = [self.model.joint(name) for name in self.joints]
        return np.array([j.qposadr[0] for j in found], np.intp), np.array([j.dofadr[0] for j in found], np.intp)

    def torque(self, position: Float, velocity: Float, acceleration: Float, *, leading: bool = True) -> Float:
        """Torque (N, n) Nm at the joint side for a motion, (N, n) each; other joints rest at their reference.

        Inverse dynamics without contacts, limits and equality constraints. MuJoCo softens dry friction to be able to
        step it in time: it brakes towards an acceleration of -b times the velocity, and so reverses 1/b s before the
        velocity. If not ``leading``, friction reverses with the velocity.
        """
        import mujoco

        data = mujoco.MjData(self.model)
        at, dof = self.places
        out = np.empty_like(np.asarray(position, np.float64))
        for i, (q, qd, qdd) in enumerate(zip(position, velocity, acceleration, strict=True)):
            data.qpos[at], data.qvel[dof], data.qacc[dof] = q, qd, qdd
            mujoco.mj_inverse(self.model, data)
            out[i] = data.qfrc_inverse[dof]
        model, turns = self.model, self._tendons()
        lead = _lead(model.dof_solref[dof], model.dof_solimp[dof]) if leading else 0.0
        out += model.dof_frictionloss[dof] * direction(velocity + lead * acceleration)
        if turns.any():
            lead = _lead(model.tendon_solref_fri, model.tendon_solimp_fri) if leading else 0.0
            out += (model.tendon_frictionloss * direction(velocity @ turns.T + lead * (acceleration @ turns.T))) @ turns
        return out

    def _tendons(self) -> Float:
        """Turns (t, n) of each fixed tendon per turn of each joint."""
        import mujoco

        model, number = self.model, [self.model.joint(name).id for name in self.joints]
        out = np.zeros((model.ntendon, len(number)))
        for tendon in range(model.ntendon):
            first = model.tendon_adr[tendon]
            for wrap in range(first, first + model.tendon_num[tendon]):
                if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_objid[wrap] in number:
                    out[tendon, number.index(model.wrap_objid[wrap])] = model.wrap_prm[wrap]
        return out

    def unit(self, joint: int, unit: str) -> str:
        """Unit at a ``joint`` (0-based) of a quantity that has ``unit`` at a hinge: ``N`` for ``N*m`` at a slide."""
        slides = self.model.joint(self.joints[joint]).type[0] == scalar_types(self.path)[1]
        return unit_at("prismatic" if slides else "revolute", unit)

    @property
    def bodies(self) -> NDArray[np.intp]:
        """The body that each joint moves, (n,)."""
        return np.array([self.model.joint(name).bodyid[0] for name in self.joints], np.intp)

    def actuators(self) -> Actuators:
        """The actuators of the joints; those that convert control to torque by their gear alone have a gain."""
        import mujoco

        model = self.model
        numbers = np.array([actuator_of(model, model.joint(name).id) for name in self.joints], np.intp)
        fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED
        motors = fixed & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
        gears = np.array([np.nan if i < 0 else model.actuator_gear[i, 0] for i in numbers])
        gains = np.array([model.actuator_gainprm[i, 0] if i >= 0 and motors[i] else np.nan for i in numbers])
        return Actuators(model.nu, numbers, gears, gears * gains)

    def poses(self, position: Float) -> tuple[Float, Float, Float]:
        """Frames (N, n, 4, 4) of ``bodies`` and anchors and axes (N, n, 3) of the joints, all in the world."""
        import mujoco

        data = mujoco.MjData(self.model)
        number = [self.model.joint(name).id for name in self.joints]
        frames = np.tile(np.eye(4), (*np.shape(position), 1, 1))
        anchors, axes = np.empty((*np.shape(position), 3)), np.empty((*np.shape(position), 3))
        for k, row in enumerate(position):
            data.qpos[self.places[0]] = row
            mujoco.mj_kinematics(self.model, data)
            frames[k, :, :3, :3] = data.xmat[self.bodies].reshape(-1, 3, 3)
            frames[k, :, :3, 3] = data.xpos[self.bodies]
            anchors[k], axes[k] = data.xanchor[number], data.xaxis[number]
        return frames, anchors, axes

    def links(self) -> Float:
        """Inertial parameters (n, 10) of ``bodies`` in their own frames."""
        out = []
        for body in self.bodies:
            principal = pin.Inertia(self.model.body_mass[body], np.zeros(3), np.diag(self.model.body_inertia[body]))
            turn = pin.Quaternion(*self.model.body_iquat[body])
            out.append(pin.SE3(turn, self.model.body_ipos[body]).act(principal).toDynamicParameters())
        return np.stack(out)


def load_simulator(path: Path, joints: Sequence[str]) -> Simulator:
    """Load the arm of an MJCF or URDF; ``joints`` are matched by name, or else by order.

    Raises ``ConfigError`` if the extra is not installed, or the file cannot be used or has no such arm.
    """
    model = compiled(path)
    for flag in LEFT_OUT:
        model.opt.disableflags |= int(getattr(library(path).mjtDisableBit, flag))
    names, notes = _matched(path, model, joints)
    _check_base(path, model, names)
    others = [j.name or f"number {j.id}" for j in map(model.joint, range(model.njnt)) if j.name not in names]
    if others:
        notes.append(f"{path.name}: held at their reference: {', '.join(others)}")
    arm = Simulator(path, model, tuple(names))
    others_only = ~arm._tendons().any(axis=1)
    cables = np.any(model.tendon_frictionloss[others_only] > 0)
    absent = {"equality constraints": model.neq > 0, "frictions of tendons": cables}
    notes += [f"{path.name}: its {what} are left out" for what, present in absent.items() if present]
    if not model.opt.gravity.any():
        notes.append(f"{path.name}: its gravity is switched off: its torques are without weight")
    if np.any(model.body_gravcomp > 0) and not np.any(model.jnt_actgravcomp):
        notes.append(f"{path.name}: gravity is compensated (gravcomp): its torques are without that weight")
    return replace(arm, notes=tuple(notes))


def _matched(path: Path, model: Any, joints: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names of the joints in the file, and notes on the matching."""
    scalar = [j.name for j in map(model.joint, range(model.njnt)) if j.type[0] in scalar_types(path)]
    missing = [name for name in joints if name not in scalar]
    if not missing:
        return list(joints), []
    if len(missing) < len(joints) or len(scalar) < len(joints) or "" in scalar[: len(joints)]:
        present = ", ".join(name or "one without name" for name in scalar) or "none"
        raise ConfigError(f"{path}: no joint {', '.join(missing)}; its hinges and slides are {present}")
    matched = scalar[: len(joints)]
    return matched, [f"{path.name}: has none of the joints of robot.yaml; matched by order: {', '.join(matched)}"]


def _check_base(path: Path, model: Any, names: Sequence[str]) -> None:
    """Raises ``ConfigError`` if the base is free, or the joints do not follow one another from the base."""
    above: list[int] = []
    body = int(model.joint(names[-1]).bodyid[0])
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        above = [*range(first, first + count), *above]
        body = int(model.body_parentid[body])
    chain = [model.joint(i) for i in above]
    loose = [j.name or "(without name)" for j in chain if j.type[0] not in scalar_types(path)]
    if loose:
        raise ConfigError(f"{path}: joint {', '.join(loose)} leaves the base free: give a model whose base is fixed")
    if [j.name for j in chain if j.name in names] != list(names):
        raise ConfigError(f"{path}: its joints do not follow one another from the base in the order of robot.yaml")


def _lead(solref: Float, solimp: Float) -> Float:
    """s (k,) by which dry friction reverses before its velocity: 1/b of its solver's ``solref`` and ``solimp``."""
    time, damping = solref.T
    most = solimp[:, 1]
    return np.asarray(np.where(time > 0, 0.5 * most * time, most / np.maximum(-damping, 1e-9)))
