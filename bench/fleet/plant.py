"""A serial arm with six joints: its motion, the torque that it needs, and its description for the user."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

JOINTS = 6
OFFSETS = np.array(
    [[0, 0, 0.16], [0.08, 0.12, 0.15], [0.48, 0, 0.0], [0.42, -0.05, 0.05], [0, 0.1, 0.08], [0, 0.09, 0.04]]
)
ROLLS = np.array([[0, 0, 0], [np.pi / 2, 0, 0], [0, 0, 0], [0, 0.2, 0], [-np.pi / 2, 0, 0], [np.pi / 2, 0, 0]])
MASSES = np.array([9.0, 12.0, 7.0, 3.0, 2.2, 1.1])
CENTRES = np.array(
    [[0.02, 0.0, 0.04], [0.24, 0, 0.02], [0.19, 0.0, 0.03], [0.01, 0.03, 0.0], [0, 0.02, 0.01], [0, 0, 0.03]]
)
INERTIAS = np.array(
    [
        [0.05, 0.06, 0.04],
        [0.03, 0.25, 0.24],
        [0.02, 0.12, 0.12],
        [6e-3, 4e-3, 6e-3],
        [4e-3, 3e-3, 4e-3],
        [1e-3] * 2 + [8e-4],
    ]
)
ROTORS = np.array([1.6, 1.9, 1.1, 0.35, 0.3, 0.22])
COULOMB = np.array([7.5, 9.0, 6.0, 2.2, 1.9, 1.5])
VISCOUS = np.array([8.0, 9.5, 6.5, 2.0, 1.7, 1.3])
TOP_SPEED = np.array([2.0, 1.8, 2.2, 3.2, 3.2, 3.6])
"""rad/s."""
CONSTANTS = np.array([9.0, 9.5, 7.0, 4.0, 4.0, 3.5])
"""Nm/A at the joint."""
RESISTANCES = np.array([0.8, 0.8, 0.9, 1.5, 1.5, 1.8])
GRAVITY = 9.80665


@dataclass(frozen=True)
class Links:
    """Masses (6,) kg, centres (6, 3) m and moments of inertia (6, 3) kg m² about them."""

    masses: Float
    centres: Float
    inertias: Float


SOUND = Links(MASSES, CENTRES, INERTIAS)


def _turn(roll: Float) -> Float:
    """Rotation of a URDF's rpy."""
    (a, b, c), cos, sin = roll, np.cos, np.sin
    x = np.array([[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]])
    y = np.array([[cos(b), 0, sin(b)], [0, 1, 0], [-sin(b), 0, cos(b)]])
    z = np.array([[cos(c), -sin(c), 0], [sin(c), cos(c), 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


_FIXED = [_turn(roll) for roll in ROLLS]


def _about_z(angle: Float) -> Float:
    out = np.zeros((len(angle), 3, 3))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0] = np.sin(angle)
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = 1.0
    return out


def _into(turns: Float, vectors: Float) -> Float:
    return np.asarray(np.einsum("nji,nj->ni", turns, vectors))


def _out_of(turns: Float, vectors: Float) -> Float:
    return np.asarray(np.einsum("nij,nj->ni", turns, vectors))


def rigid_torque(links: Links, q: Float, qd: Float, qdd: Float) -> Float:
    """Torque (N, 6) Nm of the links alone: Newton and Euler in each link's frame, all samples at once."""
    count = len(q)
    spin, gain, rise = np.zeros((count, 3)), np.zeros((count, 3)), np.tile([0.0, 0.0, GRAVITY], (count, 1))
    turns, forces, moments = [], [], []
    for i in range(JOINTS):
        turn = _FIXED[i] @ _about_z(q[:, i])
        arm = np.broadcast_to(OFFSETS[i], (count, 3))
        rise = _into(turn, rise + np.cross(gain, arm) + np.cross(spin, np.cross(spin, arm)))
        spin, gain = _into(turn, spin), _into(turn, gain)
        own = np.zeros((count, 3))
        own[:, 2] = qd[:, i]
        gain = gain + np.cross(spin, own)
        gain[:, 2] += qdd[:, i]
        spin = spin + own
        centre = np.broadcast_to(links.centres[i], (count, 3))
        force = links.masses[i] * (rise + np.cross(gain, centre) + np.cross(spin, np.cross(spin, centre)))
        inertia = links.inertias[i]
        moment = inertia * gain + np.cross(spin, inertia * spin) + np.cross(centre, force)
        turns.append(turn)
        forces.append(force)
        moments.append(moment)
    torque = np.empty((count, JOINTS))
    force, moment = np.zeros((count, 3)), np.zeros((count, 3))
    for i in reversed(range(JOINTS)):
        if i + 1 < JOINTS:
            carried = _out_of(turns[i + 1], force)
            moment = _out_of(turns[i + 1], moment) + np.cross(np.broadcast_to(OFFSETS[i + 1], (count, 3)), carried)
            force = carried
        force, moment = force + forces[i], moment + moments[i]
        torque[:, i] = moment[:, 2]
    return torque


def payload_torque(mass: float, q: Float, qd: Float, qdd: Float) -> Float:
    """Torque (N, 6) Nm of a body of ``mass`` kg, 8 cm before the flange."""
    nothing = np.zeros((JOINTS, 3))
    masses, centres = np.zeros(JOINTS), nothing.copy()
    masses[-1], centres[-1] = mass, (0.01, 0.02, 0.08)
    return rigid_torque(Links(masses, centres, nothing), q, qd, qdd)


def motion(poses: Float, speed: float, rate: float, cycles: int) -> tuple[Float, Float, Float]:
    """Positions, velocities and accelerations (N, 6) of a round through ``poses`` (P, 6), from rest to rest."""
    rest = round(0.6 * rate)
    parts = [np.tile(poses[0], (rest, 1))]
    for _ in range(cycles):
        for start, end in zip(poses, [*poses[1:], poses[0]], strict=True):
            seconds = max(0.3, float(np.max(np.abs(end - start) * 1.875 / (TOP_SPEED * speed))))
            s = np.arange(1, max(2, round(seconds * rate)) + 1)[:, None] / max(2, round(seconds * rate))
            parts.append(start + (end - start) * s**3 * (10 - 15 * s + 6 * s**2))
        parts.append(np.tile(poses[0], (rest, 1)))
    q = np.concatenate(parts)
    qd = np.gradient(q, 1 / rate, axis=0)
    return q, qd, np.gradient(qd, 1 / rate, axis=0)


def write_description(folder: Path, name: str, coulomb: Float, viscous: Float, standby: float) -> Path:
    """``robot.yaml`` and ``robot.urdf`` of the sound arm, with the friction that its user believes in."""
    folder.mkdir(parents=True, exist_ok=True)
    links = ['<link name="base"/>']
    for i in range(JOINTS):
        parent = "base" if i == 0 else f"link_{i}"
        x, y, z = CENTRES[i]
        a, b, c = INERTIAS[i]
        links.append(
            f'<link name="link_{i + 1}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{MASSES[i]}"/>'
            f'<inertia ixx="{a}" ixy="0" ixz="0" iyy="{b}" iyz="0" izz="{c}"/></inertial></link>'
            f'<joint name="joint_{i + 1}" type="revolute"><parent link="{parent}"/><child link="link_{i + 1}"/>'
            f'<origin xyz="{" ".join(map(str, OFFSETS[i]))}" rpy="{" ".join(map(str, ROLLS[i]))}"/>'
            f'<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="500" velocity="4"/></joint>'
        )
    (folder / "robot.urdf").write_text(f'<robot name="{name}">{"".join(links)}</robot>')
    lines = [f"robot: {name}", "urdf: robot.urdf", f"standby_power: {standby}", "torque_from: current", "joints:"]
    lines += [
        f"- {{name: joint_{i + 1}, torque_constant: {CONSTANTS[i]}, winding_resistance: {RESISTANCES[i]}, "
        f"rotor_inertia: {ROTORS[i]}, coulomb_friction: {coulomb[i]:.4f}, viscous_friction: {viscous[i]:.4f}}}"
        for i in range(JOINTS)
    ]
    (folder / "robot.yaml").write_text("\n".join(lines) + "\n")
    return folder / "robot.yaml"
