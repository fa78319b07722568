"""UR3e: five moves recorded by the Hein Lab (github.com/ubc-systopia/dsn-2022-rad-artifact, MIT), 25 Hz.

Kinematics, masses and centres of mass are Universal Robots' published "DH Parameters for calculations of kinematics and
dynamics"; the recordings' tool poses and torques at rest agree with them. Torque constants are not published: those of
drives of the same size in a UR10e and a UR5 stand for them.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

FOLDER = "ur3e_power"
MOVES = ("L0L1", "L1L2", "L2L3", "L3L4", "L4L5")

LENGTH = (0.0, -0.24355, -0.2132, 0.0, 0.0, 0.0)
"""a of the DH parameters, m."""
OFFSET = (0.15185, 0.0, 0.0, 0.13105, 0.08535, 0.0921)
"""d, m."""
TWIST = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
"""α, rad."""
MASS = (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261)
"""kg."""
CENTRE = ((0, -0.02, 0), (0.13, 0, 0.1157), (0.05, 0, 0.0238), (0, 0, 0.01), (0, 0, 0.01), (0, 0, -0.02))
"""m, in the frame at the end of each link."""
RADIUS = 0.04
"""m, of the tubes that the links are taken to be."""
PAYLOAD, PAYLOAD_CENTRE = 1.07, (0.0, 0.0, 0.058)
"""kg, m: as the controller was told in these recordings."""
CONSTANT = (11.0, 11.0, 9.2, 7.5, 7.5, 7.5)
"""Nm/A at the joint."""
ROTOR = (0.8, 0.8, 0.4, 0.1, 0.1, 0.1)
"""kg m² at the joint, guessed from the drives' sizes."""


def write_robot(folder: Path) -> Path:
    """``robot.yaml`` and its URDF."""
    folder.mkdir(parents=True, exist_ok=True)
    text = ['<robot name="ur3e"><link name="base"/>']
    before = np.eye(4)
    for i in range(6):
        own = _beyond(i)
        mass, centre, inertia = _link(i, own)
        c = before[:3, 3]
        roll = np.arctan2(before[2, 1], before[2, 2])
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.tolist()
        parent = "base" if i == 0 else f"link_{i}"
        text.append(
            f'<link name="link_{i + 1}"><inertial><origin xyz="{centre[0]} {centre[1]} {centre[2]}"/>'
            f'<mass value="{mass}"/><inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>'
            f'</inertial></link><joint name="joint_{i + 1}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{i + 1}"/><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="{roll} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-20" upper="20" effort="60" velocity="7"/></joint>'
        )
        before = own
    (folder / "ur3e.urdf").write_text("\n".join([*text, "</robot>"]))
    joints = [{"name": f"joint_{i + 1}", "torque_constant": CONSTANT[i], "rotor_inertia": ROTOR[i]} for i in range(6)]
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump({"robot": "ur3e", "urdf": "ur3e.urdf", "joints": joints}))
    return file


def write_moves(data: Path, folder: Path) -> list[Path]:
    """The five moves as tables: t, q_i, qd_i, current_i and power, the product of bus voltage and current."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for name in MOVES:
        rows = _read(data / FOLDER / f"{name}.csv")
        columns = {"t": rows["timestamp"], "power": rows["actual_robot_voltage"] * rows["actual_robot_current"]}
        for ours, theirs in (("q", "actual_q"), ("qd", "actual_qd"), ("current", "actual_current")):
            columns |= {f"{ours}_{i + 1}": rows[f"{theirs}_{i}"] for i in range(6)}
        out.append(folder / f"{name}.parquet")
        pq.write_table(pa.table(columns), out[-1])
    return out


def _read(path: Path) -> dict[str, np.ndarray]:
    """The columns that are numbers throughout; lines may end in CR alone."""
    text = path.read_text(errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    rows = list(csv.DictReader(io.StringIO(text)))
    wanted = [name for name in rows[0] if name == "timestamp" or name.startswith("actual_")]
    return {name: np.array([float(row[name]) for row in rows]) for name in wanted}


def _beyond(i: int) -> np.ndarray:
    """From joint i's turned frame to the frame at the end of its link."""
    c, s = np.cos(TWIST[i]), np.sin(TWIST[i])
    return np.array([[1, 0, 0, LENGTH[i]], [0, c, -s, 0], [0, s, c, OFFSET[i]], [0, 0, 0, 1.0]])


def _link(i: int, own: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre in the joint's frame, inertia about the centre; the last link with the payload."""
    turn, at = own[:3, :3], own[:3, 3]
    long = max(abs(LENGTH[i]), 2 * RADIUS)
    tube = MASS[i] * np.diag([RADIUS**2 / 2, long**2 / 12, long**2 / 12])
    mass, centre, inertia = MASS[i], np.array(CENTRE[i], float), tube
    if i == 5:
        carried = np.array(PAYLOAD_CENTRE)
        middle = (mass * centre + PAYLOAD * carried) / (mass + PAYLOAD)
        for m, r in ((mass, centre - middle), (PAYLOAD, carried - middle)):
            inertia = inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
        mass, centre = mass + PAYLOAD, middle
    return mass, turn @ centre + at, turn @ inertia @ turn.T
