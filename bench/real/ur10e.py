"""UR10e, Innopolis University (github.com/shamilmamedov/dynamic_calibration; no licence stated: figures only).

Columns without a header: time, six positions, velocities, motor currents, target currents, target torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot import Body
from real.describe import Drives, Link, with_links, write_robot
from real.recording import Float, Recording

FOLDER = "ur10e"
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
GEAR = 101.0
PUBLISHED_GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])
"""Nm/A, from the source's main.m."""
PAYLOAD = 2.805
"""kg, the load of the 14-harmonics pair as its owner weighed it."""
NO_LOAD = ("ur-20_02_19_14harm50sec", "ur-20_02_19_15harm50sec", "ur-20_02_12-50sec_12harm")
LOAD = "ur-20_02_19_14harm50secLoad"
OTHER_LOAD = "ur-20_02_19_15harm50secLoad"
"""The motion of ``OTHER_LOAD`` with nothing at the flange."""
UNSEEN_NO_LOAD = "ur-20_02_10-30sec_12harm"
COLD = "ur-20_02_12-40sec_12harm"
"""Recorded 283 s after the controller's start; ``WARM`` on the same day 515 s later."""
WARM = "ur-20_02_12-50sec_12harm"
STATIC = tuple(f"ur-20_01_17-p{i}" for i in range(1, 11))
BESIDE_JOINT_1 = "ur-20_01_22-joint_3"
"""Joint 1 rests there, and is loaded by what the others do."""
LEAST_CURRENT = 0.01
"""A, a hundred steps of the recordings' last digit."""

_COLUMNS = 31
_ABSURD = 1e3
"""No angle, speed, current or torque of this arm is that large."""
_HOLE = 1.0
"""s: a larger step of the clock is damage."""


def read(data: Path, name: str) -> Recording:
    """One file; damaged rows are dropped and counted."""
    rows, dropped = _rows(data, name)
    return Recording(
        name, rows[:, 0] - rows[0, 0], rows[:, 1:7], rows[:, 7:13], current=rows[:, 13:19], dropped=dropped
    )


def moving(data: Path, name: str) -> Recording:
    """One file without the rests at both ends, as its owner uses it."""
    return read(data, name).moving()


def body(data: Path) -> Body:
    """The arm as its maker describes it."""
    return Body(data / FOLDER / "ur10e.urdf", JOINTS)


def write(data: Path, folder: Path, drives: Drives, links: Sequence[Link] | None = None) -> Path:
    """The arm's description with these drives, and the maker's links if there are no others; returns robot.yaml."""
    urdf = (data / FOLDER / "ur10e.urdf").read_text()
    return write_robot(folder, "ur10e", JOINTS, with_links(urdf, JOINTS, links) if links else urdf, drives, 100.0)


def controller_gains(data: Path) -> Float:
    """Target torque over target current (6,) Nm/A of resting joints: the gains that the controller itself uses.

    While a joint moves, its target current holds friction as well. Joint 6 holds nothing at rest: its drive is taken
    to be that of joints 4 and 5, which are of the same size.
    """
    rows = np.concatenate([_rows(data, name)[0] for name in STATIC])
    gains = np.empty(6)
    for j in range(5):
        held = rows[np.abs(rows[:, 19 + j]) > LEAST_CURRENT] if j else _rows(data, BESIDE_JOINT_1)[0]
        current, torque = held[:, 19 + j], held[:, 25 + j]
        gains[j] = current @ torque / (current @ current)
    gains[5] = gains[4]
    return gains


def _rows(data: Path, name: str) -> tuple[Float, int]:
    path = next((data / FOLDER).rglob(f"{name}.csv"))
    lines = path.read_text().splitlines()
    rows = np.array([row for row in map(_row, lines) if row is not None])
    kept: NDArray[np.bool_] = np.diff(rows[:, 0], prepend=rows[0, 0] - 0.01) > 0
    kept &= np.abs(rows[:, 0] - np.median(rows[:, 0])) < 1e3
    rows = rows[kept]
    return rows, len(lines) - len(rows)


def _row(line: str) -> list[float] | None:
    """One line, or None where it is damaged."""
    cells = line.split(",")
    if len(cells) != _COLUMNS:
        return None
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        return None
    return row if all(abs(value) < _ABSURD for value in row[1:]) else None
