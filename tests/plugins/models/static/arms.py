"""Arms that differ from their CAD model, in plain vector mechanics: nothing of the models under test is used.

A joint carries what lies beyond it: τ_j = −z_j · Σ (r − o_j) × m g, with z_j the axis, o_j a point on it. Hoses are
springs between points of two links, their torque the slope of their energy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from energy.chain import Link
from energy.chain import rotations as turned
from energy.chain import write_robot as write_described

G = 9.81
RATED = np.array([420.0, 460.0, 260.0, 60.0, 55.0, 32.0])
LIMITS = np.array(
    [[-1.5708, 1.5708], [-0.3491, 0.3491], [-1.1355, 0.0], [-2.0944, 2.0944], [-1.5708, 1.5708], [-3.1415, 3.1415]]
)
OFFSETS = np.array([[0, 0, 0.45], [0.155, 0, 0], [0, 0, 0.614], [0.32, 0, 0.2], [0.32, 0, 0], [0.1, 0, 0]])
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0], [-1, 0, 0], [0, -1, 0], [-1, 0, 0]], float)
MASS = np.array([44.652, 30.939, 10.538, 4.9476, 2.0965, 0.6])
CENTRE = np.array(
    [
        [0.035, 0.005, -0.188],
        [-0.018, -0.092, 0.258],
        [0.089, -0.034, 0.12],
        [0.1, 0, 0.017],
        [0.026, -0.015, 0],
        [0.02, 0, 0],
    ]
)


@dataclass(frozen=True)
class Hose:
    """A spring of ``stiffness`` N/m from ``start`` on link ``first`` to ``end`` on link ``last`` (m); slack never."""

    first: int
    last: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    stiffness: float
    rest: float


@dataclass(frozen=True)
class Arm:
    """What an arm really has; torques in Nm, angles in rad. Links and joints count from 0."""

    mass: np.ndarray = field(default_factory=MASS.copy)
    centre: np.ndarray = field(default_factory=CENTRE.copy)
    limits: np.ndarray = field(default_factory=LIMITS.copy)
    rated: np.ndarray = field(default_factory=RATED.copy)
    tool: tuple[float, tuple[float, float, float]] = (0.0, (0.0, 0.0, 0.0))
    friction: np.ndarray = field(default_factory=lambda: np.zeros(6))
    load_friction: float = 0.0
    spring: np.ndarray = field(default_factory=lambda: np.zeros(6))
    relaxed: np.ndarray = field(default_factory=lambda: np.zeros(6))
    hoses: tuple[Hose, ...] = ()
    tilt: tuple[float, float] = (0.0, 0.0)
    zero: np.ndarray = field(default_factory=lambda: np.zeros(6))
    gain: np.ndarray = field(default_factory=lambda: np.ones(6))
    hold: float = 0.0012
    """What a pose differs by when it is held again, as a share of the rated torque."""
    sample: float = 0.0085
    """Noise of one sample, as a share of the rated torque."""

    def frames(self, q):
        """Rotation (N, n, 3, 3) and origin (N, n, 3) of each joint's frame."""
        rotation, origin = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
        rotations, origins = [], []
        for angle, axis, offset in zip((q + self.zero).T, AXES, OFFSETS, strict=True):
            origin = origin + rotation @ offset
            rotation = rotation @ turned(axis, angle)
            rotations.append(rotation)
            origins.append(origin)
        return np.stack(rotations, 1), np.stack(origins, 1)

    def load(self, q):
        """Torques (N, n) that gravity and springs ask for."""
        rotation, origin = self.frames(q)
        a, b = self.tilt
        down = G * np.array([np.sin(a), np.sin(b), -np.sqrt(1 - np.sin(a) ** 2 - np.sin(b) ** 2)])
        count = q.shape[1]
        points = [origin[:, i] + rotation[:, i] @ self.centre[i] for i in range(count)]
        points.append(origin[:, -1] + rotation[:, -1] @ np.array(self.tool[1]))
        masses = [*self.mass, self.tool[0]]
        out = np.zeros(q.shape)
        for j in range(count):
            axis = rotation[:, j] @ AXES[j]
            for i in [*range(j, count), count]:
                out[:, j] -= np.sum(axis * np.cross(points[i] - origin[:, j], masses[i] * down), axis=1)
        return self.gain * out + self.spring * (q - self.relaxed) + self._hose_torque(q)

    def torque(self, q, come_from):
        """True torques (N, n) held at ``q`` after coming from ``come_from``."""
        load = self.load(q)
        return load + np.sign(q - come_from) * (self.friction + self.load_friction * np.abs(load))

    def _hose_torque(self, q):
        out = np.zeros(q.shape)
        if self.hoses:
            for j in range(q.shape[1]):
                step = np.zeros(q.shape[1])
                step[j] = 1e-5
                out[:, j] = (self._energy(q + step) - self._energy(q - step)) / 2e-5
        return out

    def _energy(self, q):
        rotation, origin = self.frames(q)
        energy = np.zeros(len(q))
        for hose in self.hoses:
            ends = [
                origin[:, link] + rotation[:, link] @ np.array(point)
                for link, point in ((hose.first, hose.start), (hose.last, hose.end))
            ]
            length = np.linalg.norm(ends[1] - ends[0], axis=1)
            energy += 0.5 * hose.stiffness * (length - hose.rest) ** 2
        return energy


def halton(count, bases=(2, 3, 5, 7, 11, 13)):
    out = np.zeros((count, len(bases)))
    for d, base in enumerate(bases):
        for row in range(count):
            i, f = row + 1, 1.0
            while i:
                f /= base
                out[row, d] += f * (i % base)
                i //= base
    return out


def within(limits, share):
    return limits[:, 0] + share * (limits[:, 1] - limits[:, 0])


def samples(arm: Arm, rng, count) -> dict[str, np.ndarray]:
    """The table of a collection: whole per cent, 100 samples a pose."""
    q = within(arm.limits, halton(count))
    came = np.vstack([np.zeros(6), q[:-1]])
    held = arm.torque(q, came) / arm.rated + arm.hold * rng.standard_normal(q.shape)
    percent = np.rint(100 * (held[:, None] + arm.sample * rng.standard_normal((count, 100, 6))))
    table = {"pose": np.repeat(np.arange(count), 100), "t": np.repeat(9.0 * np.arange(count), 100)}
    table["t"] = table["t"] + np.tile(0.02 * np.arange(100), count)
    noisy = np.repeat(q, 100, axis=0) + 3e-6 * rng.standard_normal((100 * count, 6))
    table |= {f"q_{j + 1}": noisy[:, j] for j in range(6)}
    table |= {f"torque_percent_{j + 1}": percent.reshape(-1, 6)[:, j].astype(np.int16) for j in range(6)}
    return table


def unseen(arm: Arm, rng, count=400):
    """Poses, where the arm came from, and true torques."""
    q, came = (within(arm.limits, rng.random((count, 6))) for _ in range(2))
    return q, came, arm.torque(q, came)


def write_robot(folder: Path, cad: Arm) -> Path:
    """``robot.yaml`` and ``robot.urdf`` of the arm as its CAD model says."""
    links = [Link(OFFSETS[i], AXES[i], cad.mass[i], cad.centre[i], (0.1, 0.1, 0.1)) for i in range(6)]
    low, high = cad.limits.T
    joints = {"rated_torque": cad.rated, "lower_limit": low, "upper_limit": high}
    return write_described(folder, links, joints, robot="mh12")


def write_case(folder: Path, arm: Arm, seed: int, count: int = 532):
    """A folder as a user has it, and the unseen poses: samples.parquet, robot.yaml, robot.urdf."""
    rng = np.random.default_rng(seed)
    robot = write_robot(folder, Arm())
    pq.write_table(pa.table(samples(arm, rng, count)), folder / "samples.parquet")
    return robot, unseen(arm, rng)


def some_arm(seed: int) -> Arm:
    """An arm drawn at random: masses, centres, tool, friction, hoses, springs, tilt, zeros and gains all differ."""
    rng = np.random.default_rng(seed)
    centre = CENTRE + rng.normal(0, 0.015, CENTRE.shape)
    arm = Arm(
        mass=MASS * (1 + rng.normal(0, 0.12, 6)),
        centre=centre,
        tool=(float(rng.uniform(0, 5)), tuple(rng.normal((0.12, 0, 0), 0.04))),
        friction=RATED * rng.uniform(0.004, 0.02, 6),
        load_friction=float(rng.choice([0.0, 0.03, 0.06])),
    )
    if rng.random() < 0.6:
        joint = int(rng.integers(1, 4))
        spring, relaxed = np.zeros(6), np.zeros(6)
        spring[joint], relaxed[joint] = RATED[joint] * rng.uniform(0.05, 0.2), rng.normal(0, 0.3)
        arm = replace(arm, spring=spring, relaxed=relaxed)
    if rng.random() < 0.6:
        first = int(rng.integers(1, 3))
        hose = Hose(first, first + 2, (0.0, 0.1, 0.2), (0.1, 0.1, 0.1), float(rng.uniform(100, 500)), 0.25)
        arm = replace(arm, hoses=(hose,))
    if rng.random() < 0.3:
        arm = replace(arm, tilt=tuple(rng.normal(0, np.radians(0.7), 2)))
    if rng.random() < 0.3:
        arm = replace(arm, zero=rng.normal(0, np.radians(0.2), 6))
    if rng.random() < 0.3:
        arm = replace(arm, gain=1 + rng.normal(0, 0.04, 6))
    return arm
