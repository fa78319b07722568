"""A serial arm by recursive Newton-Euler in numpy, all samples at a time: shares no code with what it tests."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

GRAVITY = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class Link:
    """One joint about its ``axis`` and the link that it turns."""

    origin: tuple[float, float, float]
    """m: the joint in the frame of the one before (all frames parallel at zero)."""
    axis: tuple[float, float, float]
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]
    """kg m² about the centre, along the axes."""


def rotations(axis, angles):
    """(N, 3, 3) by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * k + (1 - c) * (k @ k)


def torques(links, q, qd, qdd, payload=0.0, tool=(0.0, 0.0, 0.0)):
    """Joint torques (N, n) Nm of the links with a point ``payload`` kg at ``tool`` m in the last frame."""
    n, count = len(links), len(q)
    turn = [rotations(link.axis, q[:, i]) for i, link in enumerate(links)]
    spin, spun = np.zeros((count, 3)), np.zeros((count, 3))
    pull = np.tile(GRAVITY, (count, 1))
    forces, moments = [], []
    for i, link in enumerate(links):
        axis, origin = np.array(link.axis), np.array(link.origin)
        back = turn[i].transpose(0, 2, 1)
        pull = _turned(back, pull + np.cross(spun, origin) + np.cross(spin, np.cross(spin, origin)))
        spin_before = _turned(back, spin)
        spun = _turned(back, spun) + np.cross(spin_before, axis * qd[:, i : i + 1]) + axis * qdd[:, i : i + 1]
        spin = spin_before + axis * qd[:, i : i + 1]
        force, moment = _inertial(link.mass, np.array(link.centre), np.array(link.inertia), spin, spun, pull)
        if i == n - 1 and payload:
            more = _inertial(payload, np.array(tool), np.zeros(3), spin, spun, pull)
            force, moment = force + more[0], moment + more[1]
        forces.append(force)
        moments.append(moment)
    out = np.empty((count, n))
    force, moment = np.zeros((count, 3)), np.zeros((count, 3))
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            carried = _turned(turn[i + 1], force)
            moment = _turned(turn[i + 1], moment) + np.cross(np.array(links[i + 1].origin), carried)
            force = carried
        force, moment = force + forces[i], moment + moments[i]
        out[:, i] = moment @ np.array(links[i].axis)
    return out


def _turned(matrices, vectors):
    return np.einsum("nij,nj->ni", matrices, vectors)


def _inertial(mass, centre, inertia, spin, spun, pull):
    """Force and moment about the joint's frame that a body needs."""
    force = mass * (pull + np.cross(spun, centre) + np.cross(spin, np.cross(spin, centre)))
    moment = spun * inertia + np.cross(spin, spin * inertia) + np.cross(centre, force)
    return force, moment


def write_urdf(links, path: Path) -> None:
    """The same arm as a URDF, with joints joint_1 … joint_n."""
    parts = ['<robot name="arm"><link name="link_0"/>']
    for i, link in enumerate(links, start=1):
        centre, origin, axis = (" ".join(f"{v:.9g}" for v in x) for x in (link.centre, link.origin, link.axis))
        a, b, c = link.inertia
        parts.append(
            f'<link name="link_{i}"><inertial><origin xyz="{centre}"/><mass value="{link.mass:.9g}"/>'
            f'<inertia ixx="{a:.9g}" ixy="0" ixz="0" iyy="{b:.9g}" iyz="0" izz="{c:.9g}"/></inertial></link>'
            f'<joint name="joint_{i}" type="revolute"><parent link="link_{i - 1}"/><child link="link_{i}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
            '<limit lower="-6.28" upper="6.28" effort="1000" velocity="10"/></joint>'
        )
    path.write_text("".join([*parts, "</robot>"]))


def write_robot(folder: Path, links, joints, **head) -> Path:
    """robot.urdf of the arm and the robot.yaml beside it: ``joints`` are values (n,) by key, ``head`` other keys."""
    folder.mkdir(parents=True, exist_ok=True)
    write_urdf(links, folder / "robot.urdf")
    columns = {key: np.asarray(values).tolist() for key, values in joints.items()}
    told = [{"name": f"joint_{i + 1}"} | {key: values[i] for key, values in columns.items()} for i in range(len(links))]
    content = {"urdf": "robot.urdf", **head, "joints": told}
    (folder / "robot.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return folder / "robot.yaml"
