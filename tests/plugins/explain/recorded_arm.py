"""An arm of the tests' own, its motions, and recordings of it with effects that its description does not know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path

import numpy as np
import pinocchio as pin

from cellwatt_plugins.explain.input.run import Run, Simulated
from cellwatt_plugins.robot.motion import Plan
from tests.plugins.explain.plant import travelled
from tests.plugins.explain.robot_file import write_arm

AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
OFFSETS = ("0 0 0.3", "0.1 0 0.1", "0 0 0.6", "0.3 0 0.1", "0.3 0 0", "0.08 0 0")
MASSES = (18.0, 14.0, 9.0, 4.0, 2.0, 0.6)
CENTRES = ("0.02 0 0.05", "0 0.03 0.28", "0.06 0 0.04", "0.15 0 0.01", "0.03 0 0", "0.02 0 0")
INERTIAS = (0.30, 0.55, 0.12, 0.05, 0.008, 0.0008)
COULOMB = np.array([11.0, 14.0, 8.0, 2.5, 2.0, 1.1])
VISCOUS = np.array([16.0, 19.0, 9.0, 1.5, 1.4, 0.6])
ROTOR = np.array([3.1, 3.4, 1.5, 0.3, 0.25, 0.08])
CONSTANT = np.array([15.0, 15.0, 11.0, 6.0, 6.0, 4.5])
RESISTANCE = np.array([0.5, 0.5, 0.7, 1.5, 1.5, 2.2])
STANDBY = 120.0
NOISE = np.array([0.8, 1.0, 0.6, 0.15, 0.12, 0.08])
JOINTS = 6


def write_robot(folder: Path, **changes: object) -> Path:
    """The arm's URDF and ``robot.yaml``; ``changes`` are the same for every joint, or keys of the robot."""
    links = [(centre, mass, (x, x, 0.6 * x)) for centre, mass, x in zip(CENTRES, MASSES, INERTIAS, strict=True)]
    joints = list(zip(AXES, OFFSETS, strict=True))
    limit = 'lower="-3.5" upper="3.5" effort="300" velocity="6"'
    drives = (JOINTS * (100.0,), CONSTANT, ROTOR, COULOMB, VISCOUS, RESISTANCE)
    return write_arm(folder, "bench", links, joints, limit, drives, {"standby_power": STANDBY}, changes)


@dataclass(frozen=True)
class Moves:
    """A planned motion, (N, n) each, and its times (N,)."""

    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


def excitation(seed: int, seconds: float = 20.0, rate: float = 100.0) -> Moves:
    """Harmonics of different phase in every joint."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, qd, qdd = np.zeros((3, len(t), JOINTS))
    q += random.uniform(-0.6, 0.6, JOINTS) + np.array([0, -0.4, 0.9, 0, 0.5, 0])
    for _ in range(4):
        w = 2 * np.pi * random.uniform(0.05, 0.4, JOINTS)
        size, phase = random.uniform(0.15, 0.45, JOINTS), random.uniform(0, 2 * np.pi, JOINTS)
        angle = np.outer(t, w) + phase
        q, qd, qdd = q + size * np.sin(angle), qd + size * w * np.cos(angle), qdd - size * w**2 * np.sin(angle)
    return Moves(t, q, qd, qdd)


def some(moves: Moves, *joints: int) -> Moves:
    """The motion of some joints, from 1; the others rest where they are at first."""
    own = np.isin(np.arange(JOINTS) + 1, joints)
    return replace(moves, q=np.where(own, moves.q, moves.q[0]), qd=moves.qd * own, qdd=moves.qdd * own)


def points(seed: int) -> Moves:
    """24 s from point to point, all joints together, with rests between."""
    random = np.random.default_rng(seed)
    t, starts = np.arange(2400) / 100, np.arange(0.5, 24.0, 2.5)
    places = [random.uniform(-1, 1, JOINTS), *random.uniform(-1.2, 1.2, (len(starts), JOINTS))]
    return Moves(t, *travelled(t, starts, repeat(2.0), places))


def model(path: Path, payload: float = 0.0, gravity: tuple[float, float, float] = (0, 0, -9.81)) -> pin.Model:
    """The real arm: with a load at the flange, or mounted otherwise."""
    arm = pin.buildModelFromUrdf(str(path.parent / "bench.urdf"))
    arm.gravity = pin.Motion(np.array(gravity), np.zeros(3))
    if payload:
        arm.inertias[JOINTS] += pin.Inertia(payload, np.array([0.12, 0.02, 0.03]), np.diag([0.01, 0.02, 0.02]))
    return arm


def needed(arm: pin.Model, moves: Moves, friction: float = 1.0) -> np.ndarray:
    """Torques (N, n) Nm of the real arm."""
    links = rigid(arm, moves.q, moves.qd, moves.qdd)
    return links + ROTOR * moves.qdd + friction * (COULOMB * np.tanh(moves.qd / 0.004) + VISCOUS * moves.qd)


def rigid(arm: pin.Model, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques (N, n) Nm that the links need."""
    data = arm.createData()
    return np.array([pin.rnea(arm, data, *row) for row in zip(q, qd, qdd, strict=True)])


def supply(torque: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Power (N,) W."""
    return STANDBY + np.sum(torque * qd + RESISTANCE * (torque / CONSTANT) ** 2, axis=1)


Effect = Callable[[Moves, np.ndarray, Path], np.ndarray]
"""The measured torque from the motion, the torque without the effect, and where the robot is described."""


def recorded(path: Path, moves: Moves, name: str = "run_01", effect: Effect | None = None, seed: int = 0) -> Run:
    """A recording of the motion with its simulation; ``effect`` changes the torque that was measured."""
    random = np.random.default_rng(seed)
    simulated = needed(model(path), moves)
    torque = simulated if effect is None else effect(moves, simulated, path)
    torque = torque + NOISE * random.standard_normal(torque.shape)
    power = supply(torque, moves.qd) + 2 * random.standard_normal(len(torque))
    plan = Plan(moves.q, moves.qd, moves.qdd)
    return Run(
        name=name,
        time=moves.time,
        position=moves.q + 1e-4 * random.standard_normal(moves.q.shape),
        velocity=moves.qd + 2e-3 * random.standard_normal(moves.q.shape),
        torque=torque,
        power=power,
        plan=plan,
        simulated=Simulated(moves.time, plan, simulated, supply(simulated, moves.qd)),
    )


def without_plan(run: Run) -> Run:
    """The recording alone."""
    return replace(run, plan=None, simulated=None)


def _later(values: np.ndarray, moves: Moves, seconds: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(moves.time - seconds, moves.time, one) for one in values.T])


def _elastic(moves: Moves, torque: np.ndarray, path: Path) -> np.ndarray:
    ringing = 60 * np.sin(2 * np.pi * 9 * moves.time) * (np.abs(moves.qdd[:, 1]) > 0.3)
    return torque + np.outer(ringing, [0, 1, 0, 0, 0, 0])


def _pushed(moves: Moves, torque: np.ndarray, path: Path) -> np.ndarray:
    push = 80 * np.exp(-(((moves.time - 7.0) / 0.3) ** 2))
    return torque + np.outer(push, [0.4, 1, 0.6, 0.1, 0.1, 0])


def _picked_up(moves: Moves, torque: np.ndarray, path: Path) -> np.ndarray:
    loaded = needed(model(path, payload=9.0), moves)
    held = (moves.time > 5) & (moves.time < 13)
    return np.where(held[:, None], loaded, torque)


EFFECTS: dict[str, Effect] = {
    "none": lambda moves, torque, path: torque,
    "payload picked up": _picked_up,
    "gain": lambda moves, torque, path: torque * np.array([1, 1.3, 0.7, 1.3, 1, 0.7]),
    "clock drift": lambda moves, torque, path: _later(torque, moves, 3e-3 * moves.time),
    "no friction": lambda moves, torque, path: needed(model(path), moves, friction=0.0),
    "much friction": lambda moves, torque, path: needed(model(path), moves, friction=4.0),
    "saturation": lambda moves, torque, path: np.clip(
        torque, -0.5 * np.ptp(torque, 0) / 2, 0.5 * np.ptp(torque, 0) / 2
    ),
    "vibration": lambda moves, torque, path: torque + np.outer(np.sin(2 * np.pi * 17 * moves.time), 15 * NOISE),
    "tilt": lambda moves, torque, path: needed(model(path, gravity=(1.7, 0.8, -9.62)), moves),
    "ceiling": lambda moves, torque, path: needed(model(path, gravity=(0, 0, 9.81)), moves),
    "elasticity": _elastic,
    "contact": _pushed,
    "balancer": lambda moves, torque, path: torque - np.outer(moves.q[:, 1] - 0.2, [0, 120, 0, 0, 0, 0]),
    "offset": lambda moves, torque, path: torque + 10 * NOISE,
    "coarse current": lambda moves, torque, path: np.round(torque / (4 * NOISE)) * 4 * NOISE,
}
"""Strong ones: all of them are what a robot, its drives or its mounting may do."""
