"""Supply power and encoders of an emulated arm on a path, healthy or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from concealed.arms import Arm, Array
from concealed.law import RigidBody

from faults.tasks import Path

JOINT_FAULTS = ("spring", "friction", "winding", "drive_cut", "belt_off")
ENCODER_FAULTS = ("encoder_stuck", "encoder_scale", "encoder_offset")
SIZES = {
    "spring": (1.5, 4.0, 8.0),
    "friction": (0.5, 1.0, 2.0),
    "winding": (0.4, 0.8, 1.6),
    "encoder_offset": (0.03, 0.06, 0.15),
    "encoder_scale": (0.06, 0.12, 0.3),
    "drive_cut": (1.0, 1.0, 1.0),
    "belt_off": (1.0, 1.0, 1.0),
    "encoder_stuck": (1.0, 1.0, 1.0),
}
"""Small, the paper's, large: a spring over a radian and friction in multiples of Coulomb friction, winding as share."""


@dataclass(frozen=True)
class Fault:
    """Something wrong with `joint` (0-based) for a whole cycle; `size` as in SIZES, `place` 0 … 1 where it begins."""

    what: str
    joint: int
    size: float
    place: float

    @property
    def kind(self) -> str:
        """joint or encoder."""
        return "encoder" if self.what in ENCODER_FAULTS else "joint"


@dataclass(frozen=True)
class Cell:
    """What the description does not say: Stribeck friction (share of Coulomb, rad/s), friction by load, share of the
    power that drives give back and of what they take, watts of the part, meter's noise, encoder noise."""

    arm: Arm
    stribeck: tuple[float, float]
    by_load: float
    given_back: float
    efficiency: float
    tool: float
    part: float
    noise: float
    encoder_noise: float
    delay: float


def draw_cell(rng: np.random.Generator, arm: Arm) -> Cell:
    """A cell around an arm."""
    return Cell(
        arm=arm,
        stribeck=(float(rng.uniform(0.0, 0.2)), float(rng.uniform(0.03, 0.15))),
        by_load=float(rng.uniform(0.0, 0.03)),
        given_back=float(rng.choice([1.0, 0.5, 0.0])),
        efficiency=float(rng.uniform(0.85, 1.0)),
        tool=float(rng.uniform(0.0, 0.15)) * arm.rated_payload,
        part=float(rng.uniform(0.05, 0.25)) * arm.rated_payload,
        noise=float(rng.uniform(0.6, 2.0)),
        encoder_noise=float(rng.uniform(1e-5, 1e-4)),
        delay=float(rng.uniform(-0.003, 0.01)),
    )


def measure(
    cell: Cell, path: Path, held: Array, *, part: float, warmth: float, faults: Sequence[Fault]
) -> tuple[Array, Array]:
    """Encoders (N, n) and power (N,) without noise; `held` (N,) whether the part is in the gripper, `part` kg,
    `warmth` the share by which friction is higher."""
    arm, q, v, a = cell.arm, path.q.copy(), path.v.copy(), path.a.copy()
    still = [f.joint for f in faults if f.what in ("drive_cut", "belt_off")]
    q[:, still], v[:, still], a[:, still] = q[0, still], 0.0, 0.0
    rigid = RigidBody(arm, (cell.tool, np.array([0.0, 0.0, 0.04]))).torque(q, v, a)
    if held.any():
        loaded = RigidBody(arm, (cell.tool + part, np.array([0.0, 0.0, 0.06]))).torque(q, v, a)
        rigid = np.where(held[:, None], loaded, rigid)
    rubbing = friction(cell, v, rigid) * (1.0 + warmth)
    torque = rigid + arm.rotor * a + rubbing
    resistance = arm.resistance.copy()
    for fault in faults:
        j = fault.joint
        if fault.what == "spring":
            slack = np.quantile(path.q[:, j], fault.place)
            torque[:, j] += fault.size * arm.coulomb[j] * (q[:, j] - slack)
        elif fault.what == "friction":
            torque[:, j] += fault.size * rubbing[:, j]
        elif fault.what == "winding":
            resistance[j] *= 1.0 + fault.size
    drives = torque * v + resistance * (torque / arm.constant) ** 2
    drives[:, still] = 0.0
    for fault in faults:
        if fault.what == "belt_off":
            drives[:, fault.joint] = alone(cell, path, fault)
    total = drives.sum(axis=1)
    power = arm.standby + np.where(total > 0, total / cell.efficiency, cell.given_back * total)
    return encoders(q, path, faults), power


def friction(cell: Cell, v: Array, load: Array) -> Array:
    """(N, n) Nm."""
    arm, (excess, width) = cell.arm, cell.stribeck
    level = arm.coulomb * (1.0 + excess * np.exp(-((v / width) ** 2))) + cell.by_load * np.abs(load)
    return np.asarray(level * np.tanh(v / 0.004) + arm.viscous * v)


def alone(cell: Cell, path: Path, fault: Fault) -> Array:
    """Power (N,) of a motor without its belt: its rotor and a share of the friction."""
    j, v, a = fault.joint, path.v[:, fault.joint], path.a[:, fault.joint]
    share = 0.2 + 0.5 * fault.place
    torque = share * (cell.arm.coulomb[j] * np.tanh(v / 0.004) + cell.arm.viscous[j] * v) + 0.5 * cell.arm.rotor[j] * a
    return np.asarray(torque * v + cell.arm.resistance[j] * (torque / cell.arm.constant[j]) ** 2)


def encoders(q: Array, path: Path, faults: Sequence[Fault]) -> Array:
    """What the encoders show of positions (N, n)."""
    shown = q.copy()
    for fault in faults:
        j = fault.joint
        if fault.what == "encoder_offset":
            shown[:, j] += fault.size * (1 if fault.place > 0.5 else -1)
        elif fault.what == "encoder_scale":
            shown[:, j] = q[0, j] + (1.0 + fault.size * (1 if fault.place > 0.5 else -1)) * (q[:, j] - q[0, j])
        elif fault.what == "encoder_stuck":
            moving = np.flatnonzero(np.abs(path.v[:, j]) > 0.05)
            start = moving[int(fault.place * 0.7 * len(moving))]
            shown[start:, j] = shown[start, j]
    return shown
