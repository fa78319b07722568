"""A plant in closed form whose program confuses two kinds of friction: slow where the load is great, fast where not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from cellwatt_plugins.mismatch.input.run import Motion, Run, Simulated
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import Plan
from tests.plugins.robot import planar_arm

COULOMB, VISCOUS = np.array([2.0, 1.0]), np.array([3.0, 1.5])
NOISE = 0.6
RATE = 100.0
NAMES = ("shoulder", "elbow")


def arm(folder: Path) -> Arm:
    """What the simulation knows of the planar arm; the shoulder's limits are tighter than the URDF's."""
    (folder / "arm.urdf").write_text(planar_arm.urdf())
    joints = [
        {"name": name, "coulomb_friction": float(c), "viscous_friction": float(v)}
        for name, c, v in zip(NAMES, COULOMB, VISCOUS, strict=True)
    ]
    joints[0] |= {"lower_limit": -0.2, "upper_limit": 1.9, "velocity_limit": 2.0}
    (folder / "robot.yaml").write_text(
        yaml.safe_dump({"robot": "planar", "urdf": "arm.urdf", "sample_rate": RATE, "joints": joints})
    )
    return Arm.load(folder / "robot.yaml")


def program(times: int = 1) -> Motion:
    """Slowly about the horizontal, fast about the vertical, the elbow at rest; back, and again."""
    down = np.pi / 2
    legs = [(0.0, 0.1, 4.0), (0.1, 0.0, 4.0)] * 2 + [(0.0, down - 0.1, 2.0)]
    legs += [(down - 0.1, down + 0.1, 0.4), (down + 0.1, down - 0.1, 0.4)] * 4
    again = [*legs, (down - 0.1, 0.0, 2.0)]
    parts = [_leg(*leg) for leg in again * (times - 1) + legs]
    q, qd, qdd = (np.concatenate(column) for column in zip(*parts, strict=True))
    rest = np.zeros_like(q)
    columns = [np.column_stack([one, rest]) for one in (q, qd, qdd)]
    return Motion(np.arange(len(q)) / RATE, *columns)


def _leg(start, end, seconds):
    s, go = np.arange(0, 1, 1 / (seconds * RATE)), end - start
    turn = 2 * np.pi * s
    return (
        start + go * (s - np.sin(turn) / (2 * np.pi)),
        go * (1 - np.cos(turn)) / seconds,
        go * 2 * np.pi * np.sin(turn) / seconds**2,
    )


def recorded(motion: Motion, effect: str | None, name: str = "run_01", seed: int = 1) -> Run:
    """The arm in motion, with an effect at the shoulder that the simulation lacks."""
    random = np.random.default_rng(seed)
    q, qd, qdd = motion.position, motion.velocity, motion.acceleration
    rigid, sign = planar_arm.torque(q, qd, qdd), np.tanh(qd / 0.004)
    simulated = rigid + COULOMB * sign + VISCOUS * qd
    torque = simulated + NOISE * random.standard_normal(q.shape)
    if effect == "load_dependent_friction":
        torque[:, 0] += 0.06 * np.abs(rigid[:, 0]) * sign[:, 0]
    if effect == "stribeck_friction":
        torque[:, 0] += 2.0 * np.exp(-np.square(qd[:, 0] / 0.4)) * sign[:, 0]
    seen = q + 1e-4 * random.standard_normal(q.shape)
    plan = Plan(q, qd, qdd)
    return Run(name, motion.time, seen, None, torque, plan=plan, simulated=Simulated(motion.time, plan, simulated))
