"""A planar arm of two links in the vertical plane, its dynamics in closed form.

Both joints turn about the base's y axis; at 0 both links point along x. A positive angle lowers the links.
(Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, ch. 6.4, with the angles counted downwards.)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

L1 = 0.7
"""m, length of the first link."""
C1, C2 = 0.31, 0.22
"""m, centres of mass along the links."""
M1, M2 = 5.2, 3.1
"""kg."""
I1, I2 = 0.21, 0.07
"""kg m² about the centres of mass."""
G = 9.81

LINK = """<link name="{name}"><inertial><origin xyz="{centre} 0.05 0"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="{inertia}" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{offset} 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="3"/></joint>"""


def urdf(kind: str = "revolute", gripper: bool = False) -> str:
    """The arm; with ``gripper`` there is a third moving joint that has no mass behind it."""
    parts = [
        '<link name="base"/>',
        LINK.format(name="upper", centre=C1, mass=M1, inertia=I1),
        LINK.format(name="lower", centre=C2, mass=M2, inertia=I2),
        JOINT.format(name="shoulder", kind="revolute", parent="base", child="upper", offset=0),
        JOINT.format(name="elbow", kind=kind, parent="upper", child="lower", offset=L1),
    ]
    if gripper:
        parts.append('<link name="finger"/>')
        parts.append(JOINT.format(name="grip", kind="revolute", parent="lower", child="finger", offset=0.4))
    return f'<robot name="planar">{"".join(parts)}</robot>'


def write(folder: Path, **arm: Any) -> Path:
    """The URDF as a file."""
    (folder / "arm.urdf").write_text(urdf(**arm))
    return folder / "arm.urdf"


def mass_matrix(q: np.ndarray) -> np.ndarray:
    """(N, 2, 2) kg m²."""
    coupling = M2 * L1 * C2 * np.cos(q[:, 1])
    m11 = I1 + I2 + M1 * C1**2 + M2 * (L1**2 + C2**2) + 2 * coupling
    m12 = I2 + M2 * C2**2 + coupling
    m22 = np.full(len(q), I2 + M2 * C2**2)
    return np.array([[m11, m12], [m12, m22]]).transpose(2, 0, 1)


def coriolis(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """(N, 2) Nm."""
    h = M2 * L1 * C2 * np.sin(q[:, 1])
    return np.column_stack([-h * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2), h * qd[:, 0] ** 2])


def gravity(q: np.ndarray, down: tuple[float, float] = (0.0, -G)) -> np.ndarray:
    """(N, 2) Nm that hold the arm still; ``down`` is gravity along x and z, m/s²."""
    along_x, along_z = down
    both = q[:, 0] + q[:, 1]

    def moment(reach: float, angle: np.ndarray) -> np.ndarray:
        return reach * (along_x * np.sin(angle) + along_z * np.cos(angle))

    second = moment(M2 * C2, both)
    return np.column_stack([moment(M1 * C1 + M2 * L1, q[:, 0]) + second, second])


def torque(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """(N, 2) Nm."""
    return np.einsum("nij,nj->ni", mass_matrix(q), qdd) + coriolis(q, qd) + gravity(q)


def motion(count: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations (N, 2) drawn at random."""
    random = np.random.default_rng(seed)
    return random.uniform(-3, 3, (count, 2)), random.uniform(-2, 2, (count, 2)), random.uniform(-9, 9, (count, 2))
