"""A SCARA of two turning joints and a slide, whose torques and forces are written down in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

REACH, OUT = 0.4, 0.3
"""m of the first link, and from the second joint to the quill."""
MASSES = (6.0, 4.0, 1.5)
FRICTION = (3.0, 2.0, 12.0)
"""Nm, Nm, N."""
G = 9.81


def urdf() -> str:
    """Links are points: the first in its middle, the second at its joint, the quill on the slide."""
    places, kinds = ("0 0 0.5", f"{REACH} 0 0", f"{OUT} 0 0"), ("revolute", "revolute", "prismatic")
    parts = ['<robot name="scara"><link name="link_0"/>']
    for i, (mass, place, kind) in enumerate(zip(MASSES, places, kinds, strict=True), start=1):
        centre = f"{REACH / 2} 0 0" if i == 1 else "0 0 0"
        parts.append(
            f'<link name="link_{i}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            '<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="axis_{i}" type="{kind}"><parent link="link_{i - 1}"/><child link="link_{i}"/>'
            f'<origin xyz="{place}"/><axis xyz="0 0 1"/>'
            '<limit lower="-2.5" upper="2.5" effort="0" velocity="0"/></joint>'
        )
    return "\n".join([*parts, "</robot>"])


def write(folder: Path, **joint: object) -> Path:
    """The URDF and a ``robot.yaml`` beside it; ``joint`` are keys of every joint."""
    (folder / "scara.urdf").write_text(urdf())
    joints = [{"name": f"axis_{i}", "coulomb_friction": f} | joint for i, f in enumerate(FRICTION, start=1)]
    (folder / "robot.yaml").write_text(yaml.safe_dump({"robot": "scara", "urdf": "scara.urdf", "joints": joints}))
    return folder / "robot.yaml"


def motion(seconds: float = 20.0, rate: float = 125.0, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Time (N,), and position, velocity and acceleration (N, 3) of sums of sines."""
    random, time = np.random.default_rng(seed), np.arange(round(seconds * rate)) / rate
    q, qd, qdd = (np.zeros((len(time), 3)) for _ in range(3))
    for joint, size in enumerate((0.6, 0.6, 0.06)):
        for _ in range(3):
            a, w, p = random.uniform(0.3, 1.0) * size, random.uniform(0.5, 4.0), random.uniform(0, 6.28)
            q[:, joint] += a * np.sin(w * time + p)
            qd[:, joint] += a * w * np.cos(w * time + p)
            qdd[:, joint] -= a * w**2 * np.sin(w * time + p)
    return time, q, qd, qdd


def torque(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques Nm of the two turning joints and force N of the slide (N, 3), by Lagrange's equations, with friction."""
    first, second, quill = MASSES
    outer, both = quill * OUT**2, second + quill
    mixed = quill * REACH * OUT
    bend, turn = np.cos(q[:, 1]), np.sin(q[:, 1])
    out = np.empty_like(q)
    own = first * REACH**2 / 4 + both * REACH**2 + outer
    out[:, 0] = (own + 2 * mixed * bend) * qdd[:, 0] + (outer + mixed * bend) * qdd[:, 1]
    out[:, 0] -= mixed * turn * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
    out[:, 1] = (outer + mixed * bend) * qdd[:, 0] + outer * qdd[:, 1] + mixed * turn * qd[:, 0] ** 2
    out[:, 2] = quill * (qdd[:, 2] + G)
    return out + np.array(FRICTION) * np.tanh(qd / 0.004)
