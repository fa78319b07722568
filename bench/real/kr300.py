"""KUKA KR 300 R2500 ultra (github.com/JonasWeigand/Robot_Identification, MIT). Torque from motor currents, 250 Hz.

Weigand, Ulmen, Janot, Ruskowski: Real-time nonlinear parameter identification for an industrial robot, 2021. An arm of
a ton with a load of 150 kg and a hydraulic balancer on joint 2, which the published model describes by its geometry.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from real.describe import Drives, Link, chain, write_robot
from real.recording import Float, Recording

FOLDER = "kuka_kr300"
"""A checkout of the source's repository, at its commit 9e403c0."""
JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
RUNS = ("A", "B", "C")
RATE = 250.0
BALANCED = 1
"""The joint (0-based) that the balancer acts on."""

GEAR = np.array([1798 / 7, 1872 / 7, 757 / 3, 221.0, 5032 / 21, 206793 / 1340])
ROTOR = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173]) * GEAR**2
"""kg m² at the joint side, from the model's data sheet."""
COULOMB = np.array([285.36, 10.0, 29.859, 34.34, 10.0, 15.449]) + np.array(
    [70.135, 232.33, 264.635, 16.0465, 36.734, 60.68]
)
"""Nm: the two terms of the published friction, one turning over more slowly than the other."""
VISCOUS = np.array([2050.35, 2306.7, 2024.4, 453.66, 1000.0, 458.8])
"""Nm s/rad, published."""

OFFSET = np.array([0.0, -np.pi / 2, np.pi, 0.0, 0.0, 0.0])
"""rad from the recorded angles to those of the model's frames."""
_A = (0.350, 1.15, 0.041, 0.0, 0.0, 0.0)
_ALPHA = tuple(np.pi / 2 * turns for turns in (1, 0, -1, 1, -1, 2))
_D = (-0.675, -0.189, 0.189, -1.0, 0.0, -0.24)
"""The published frames: standard Denavit-Hartenberg, hanging from a base that is turned over."""
_LOAD, _LOAD_AT = 150.0, 0.100
_HAND, _HAND_AT = 17.78, -0.050
"""kg, and m along the axis of joint 6, of the load and of the hand that carries it."""
_MASSES = (395.40, 339.12, 105.21, 35.80, 31.46, _LOAD + _HAND)
_CENTRES = (
    (-0.353, 0.174, -0.004),
    (-0.709, -0.001, 0.023),
    (-0.018, -0.018, -0.076),
    (0.0, 0.236, 0.001),
    (0.0, -0.080, -0.009),
    (0.0, 0.0, (_LOAD * _LOAD_AT + _HAND * _HAND_AT) / (_LOAD + _HAND)),
)
_INERTIAS = (
    (16.733765, 29.799119, 32.814954, -1.703664, 0.129384, 4.404062),
    (7.507819, 88.886691, 88.673761, 0.430046, 0.173157, -4.396607),
    (10.783798, 10.186135, 1.943179, 0.118474, -0.606384, -0.101950),
    (0.425035, 0.217993, 0.428465, -0.000004, -0.011353, -0.000027),
    (0.283826, 0.229562, 0.258266, -0.000004, -0.019521, -0.000120),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""xx, yy, zz, xy, yz, xz about the centre of mass; of the last link none is published."""


def drives() -> Drives:
    """Rotors and friction as published; the torques are recorded, so that no gain is needed."""
    return Drives(COULOMB, VISCOUS, ROTOR, np.zeros(len(JOINTS)))


def read(data: Path, run: str) -> Recording:
    """One of the three motions of 10 s; encoders at the motors."""
    path = data / FOLDER / "data" / "recorded_trajectories" / f"2020-10-21 10s FF {run} 08ms" / "data.mat"
    stored = loadmat(path, squeeze_me=True)["rec"]

    def recorded(name: str) -> Float:
        return np.asarray(stored[name].item(), np.float64).T

    position = np.radians(recorded("act_pos_mot_deg")) + OFFSET
    velocity = np.radians(recorded("act_vel_mot_deg_per_s"))
    torque = recorded("act_torque_abs_nm") * GEAR
    return Recording(run, recorded("time_cont"), position, velocity, torque=torque)


def urdf() -> str:
    """The published arm, without its balancer."""
    frames = list(zip((0.0, *_A), (np.pi, *_ALPHA), _D, strict=False))
    return chain("kr300", JOINTS, frames, [_link(i) for i in range(len(JOINTS))])


def write(folder: Path, told: Drives) -> Path:
    """The description of the published arm, with these drives; returns the path of robot.yaml."""
    return write_robot(folder, "kr300", JOINTS, urdf(), told, RATE)


def balancer(angle: Float) -> Float:
    """Torque Nm that the motor of joint 2 needs more at ``angle`` (N,) rad of the frames: the published accumulator.

    A piston on a nitrogen bladder between two anchors, 0.8 m and 0.2 m from the joint.
    """
    far, near = 0.8, 0.2
    area = np.pi * (0.055**2 - 0.030**2) / 4
    nitrogen = 1.01 * 296.8 * 328 * 2 * 0.0795
    turned = angle + np.radians(95)
    length = np.sqrt(far**2 + near**2 - 2 * far * near * np.cos(turned))
    pressure = nitrogen / (2 * 0.00048 - (length - (far - near)) * area)
    return np.asarray(np.sin(turned) * far * near / length * pressure * area)


def _link(i: int) -> Link:
    """Link ``i`` (0-based) in the frame of its own joint: the published frame lies at its other end."""
    cos, sin = np.cos(_ALPHA[i]), np.sin(_ALPHA[i])
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    xx, yy, zz, xy, yz, xz = _INERTIAS[i]
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    x, y, z = turn @ np.array(_CENTRES[i]) + np.array([_A[i], 0, 0])
    sides = tuple(float(inertia[row, column]) for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    return Link(_MASSES[i], (float(x), float(y), float(z)), sides)  # type: ignore[arg-type]
