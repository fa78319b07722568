"""Emulated arms at rest, by MuJoCo: gravity of rigid bodies and hoses as tendons; friction by the way they came.

An arm differs from its CAD model in masses, centres of mass, a tool, a hose and a spring, friction and the levelling of
its base, all drawn at random. Nothing of the models under test is used here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

RATED = np.array([420.0, 460.0, 260.0, 60.0, 55.0, 32.0])
LIMITS = np.array(
    [[-1.5708, 1.5708], [-0.3491, 0.3491], [-1.1355, 0.0], [-2.0944, 2.0944], [-1.5708, 1.5708], [-3.1415, 3.1415]]
)
PLACES = ((0, 0, 0.45), (0.155, 0, 0), (0, 0, 0.614), (0.32, 0, 0.2), (0.32, 0, 0), (0.1, 0, 0))
AXES = ((0, 0, 1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0), (-1, 0, 0))
MASSES = np.array([44.652, 30.939, 10.538, 4.9476, 2.0965, 0.6])
CENTRES = np.array(
    [
        [0.035, 0.005, -0.188],
        [-0.018, -0.092, 0.258],
        [0.089, -0.034, 0.12],
        [0.096, 0, 0.017],
        [0.026, -0.015, 0],
        [0.02, 0, 0],
    ]
)
BASES = (2, 3, 5, 7, 11, 13)
SAMPLES = 100
SAMPLE_NOISE = 0.0085
"""Of one sample, as a share of the rated torque."""
HOLD_NOISE = 0.0012
"""What a pose differs by when it is held again."""


@dataclass(frozen=True)
class HeldArm:
    """One arm; torques in Nm."""

    model: mujoco.MjModel
    friction: np.ndarray
    load_friction: float

    def load(self, q: np.ndarray) -> np.ndarray:
        """Torques (N, 6) that gravity, hose and spring ask for."""
        data = mujoco.MjData(self.model)
        out = np.empty(q.shape)
        for row, angles in enumerate(q):
            data.qpos[:] = angles
            mujoco.mj_forward(self.model, data)
            out[row] = data.qfrc_bias - data.qfrc_passive
        return out

    def torque(self, q: np.ndarray, came: np.ndarray) -> np.ndarray:
        """Torques (N, 6) held at ``q`` after coming from ``came``."""
        load = self.load(q)
        return load + np.sign(q - came) * (self.friction + self.load_friction * np.abs(load))


def some_arm(seed: int) -> HeldArm:
    """An arm drawn at random."""
    rng = np.random.default_rng((7, seed))
    mass = MASSES * (1 + rng.normal(0, 0.1, 6))
    centre = CENTRES + rng.normal(0, 0.01, CENTRES.shape)
    stiff, relaxed = np.zeros(6), np.zeros(6)
    joint = int(rng.integers(1, 4))
    stiff[joint], relaxed[joint] = RATED[joint] * rng.uniform(0.03, 0.12), rng.normal(0, 0.3)
    tool = (float(rng.uniform(0, 4)), rng.normal((0.1, 0, 0), 0.03))
    hose = (int(rng.integers(1, 4)), float(rng.uniform(0, 150)))
    tilt = rng.normal(0, np.radians(0.3), 2)
    model = mujoco.MjModel.from_xml_string(_xml(mass, centre, stiff, relaxed, tool, hose, tilt))
    return HeldArm(model, RATED * rng.uniform(0.004, 0.02, 6), float(rng.choice([0.0, 0.03, 0.06])))


def collection(arm: HeldArm, seed: int, count: int) -> dict[str, np.ndarray]:
    """The samples of a collection in the order of the Halton sequence, in whole per cent."""
    rng = np.random.default_rng((11, seed))
    q = LIMITS[:, 0] + halton(count) * (LIMITS[:, 1] - LIMITS[:, 0])
    held = arm.torque(q, np.vstack([np.zeros(6), q[:-1]])) / RATED + HOLD_NOISE * rng.standard_normal(q.shape)
    noisy = held[:, None] + SAMPLE_NOISE * rng.standard_normal((count, SAMPLES, 6))
    percent = np.rint(100 * noisy).reshape(-1, 6)
    table = {"pose": np.repeat(np.arange(count), SAMPLES), "t": np.repeat(9.0 * np.arange(count), SAMPLES)}
    table |= {f"q_{j + 1}": np.repeat(q[:, j], SAMPLES) for j in range(6)}
    return table | {f"torque_percent_{j + 1}": percent[:, j] for j in range(6)}


def unseen(arm: HeldArm, seed: int, count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Other poses, where the arm came from, and the true torques."""
    rng = np.random.default_rng((13, seed))
    q, came = (LIMITS[:, 0] + rng.random((count, 6)) * (LIMITS[:, 1] - LIMITS[:, 0]) for _ in range(2))
    return q, came, arm.torque(q, came)


def write_samples(table: dict[str, np.ndarray], path: Path) -> None:
    """As the user has them."""
    pq.write_table(pa.table(table), path)


def write_robot(folder: Path) -> Path:
    """robot.yaml and robot.urdf of the CAD model."""
    links = [
        f'<link name="link_{i + 1}"><inertial><origin xyz="{_text(CENTRES[i])}"/><mass value="{MASSES[i]}"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        f'<joint name="joint_{i + 1}" type="revolute"><parent link="{f"link_{i}" if i else "base"}"/>'
        f'<child link="link_{i + 1}"/><origin xyz="{_text(PLACES[i])}"/><axis xyz="{_text(AXES[i])}"/>'
        '<limit lower="-6.28" upper="6.28" effort="1000" velocity="4"/></joint>'
        for i in range(6)
    ]
    (folder / "robot.urdf").write_text(f'<robot name="mh12"><link name="base"/>{"".join(links)}</robot>')
    joints = [
        f"- {{name: joint_{i + 1}, rated_torque: {RATED[i]}, lower_limit: {low}, upper_limit: {high}}}"
        for i, (low, high) in enumerate(LIMITS.tolist())
    ]
    file = folder / "robot.yaml"
    file.write_text("\n".join(["robot: mh12", "urdf: robot.urdf", "joints:", *joints]) + "\n")
    return file


def halton(count: int) -> np.ndarray:
    """(count, 6) in 0 … 1."""
    out = np.zeros((count, len(BASES)))
    for column, base in enumerate(BASES):
        for row in range(count):
            left, place = row + 1, 1.0
            while left:
                place /= base
                left, digit = divmod(left, base)
                out[row, column] += place * digit
    return out


def _xml(
    mass: np.ndarray,
    centre: np.ndarray,
    stiff: np.ndarray,
    relaxed: np.ndarray,
    tool: tuple[float, np.ndarray],
    hose: tuple[int, float],
    tilt: np.ndarray,
) -> str:
    """The arm as MJCF; the hose is a tendon from link ``hose[0]`` to the second link after it, ``hose[1]`` N/m."""
    first, pull = hose
    ends = {first: ("start", (0.0, 0.1, 0.15)), min(first + 2, 6): ("end", (0.05, 0.08, 0.06))}
    carried, place = tool
    body = (
        f'<body pos="{_text(place)}"><inertial pos="0 0 0" mass="{carried + 1e-9}" '
        'diaginertia="1e-6 1e-6 1e-6"/></body>'
    )
    for i in reversed(range(6)):
        site = ""
        if i + 1 in ends:
            name, place = ends[i + 1]
            site = f'<site name="{name}" pos="{_text(place)}"/>'
        body = (
            f'<body pos="{_text(PLACES[i])}"><joint name="j{i}" type="hinge" axis="{_text(AXES[i])}" '
            f'stiffness="{stiff[i]}" springref="{np.degrees(relaxed[i])}"/>'
            f'<inertial pos="{_text(centre[i])}" mass="{mass[i]}" diaginertia="0.1 0.1 0.1"/>{site}{body}</body>'
        )
    down = 9.81 * np.array([np.sin(tilt[0]), np.sin(tilt[1]), -np.cos(tilt[0]) * np.cos(tilt[1])])
    return (
        f'<mujoco><option gravity="{_text(down)}"/><worldbody>{body}</worldbody><tendon><spatial stiffness="{pull}" '
        'springlength="0.3"><site site="start"/><site site="end"/></spatial></tendon></mujoco>'
    )


def _text(values: object) -> str:
    return " ".join(f"{float(x):.12g}" for x in np.asarray(values))
