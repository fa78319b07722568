"""The arm of the demo: its numbers, drawn at random, and its file for MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float

JOINTS = 4
NAMES = ("base", "shoulder", "elbow", "wrist")
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1]], np.float64)
PLACES = np.array([[0, 0, 0.3], [0, 0, 0.2], [0, 0, 0.5], [0, 0, 0.4]])
"""Position of each joint in the frame of the joint before, m."""
RANGES = np.array([[-2.6, 2.6], [-1.2, 1.5], [-1.8, 1.8], [-2.8, 2.8]])
"""Limits of each joint, rad."""
OFF = {"links": 0.015, "friction": 0.03, "rotors": 0.015}
"""Relative standard deviations of the numbers in the user's file: half of the default tolerances of ``explain``."""


@dataclass(frozen=True)
class Arm:
    """Numbers of an arm, each (n,) or (n, 3): kg, m, kg m² (main axes), Nm, Nm s/rad, kg m²."""

    mass: Float
    centre: Float
    inertia: Float
    frictionloss: Float
    damping: Float
    armature: Float


def draw(rng: np.random.Generator) -> Arm:
    """Draw an arm of the size of a light industrial one."""

    def about(*values: float) -> Float:
        return np.array(values) * rng.uniform(0.75, 1.3, len(values))

    mass = about(6.0, 8.0, 4.0, 1.2)
    length = np.array([0.1, 0.25, 0.2, 0.05])
    centre = np.column_stack([rng.uniform(-0.02, 0.02, (JOINTS, 2)), length * rng.uniform(0.8, 1.2, JOINTS)])
    slender = mass * (2 * length) ** 2 / 12 + 0.003
    inertia = np.column_stack([slender, slender, 0.3 * slender + 0.002])
    return Arm(mass, centre, inertia, about(4, 5, 3, 1), about(3, 4, 2, 0.5), about(0.8, 0.9, 0.4, 0.1))


def believed(arm: Arm, rng: np.random.Generator) -> Arm:
    """The arm in the user's simulation: each number is off by a few per cent."""

    def off(values: Float, kind: str) -> Float:
        return np.asarray(values * np.exp(OFF[kind] * rng.standard_normal(values.shape)))

    size = np.exp(OFF["links"] * rng.standard_normal(JOINTS))
    return replace(
        arm,
        mass=arm.mass * size,
        centre=off(arm.centre, "links"),
        inertia=arm.inertia * size[:, None],
        frictionloss=off(arm.frictionloss, "friction"),
        damping=off(arm.damping, "friction"),
        armature=off(arm.armature, "rotors"),
    )


def mjcf(arm: Arm) -> str:
    """The arm's MJCF as a user of MuJoCo would have it: one motor per joint, with the torque as its control."""
    root = ET.Element("mujoco", model="demo_arm")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", timestep="0.001")
    body = ET.SubElement(root, "worldbody")
    for i, name in enumerate(NAMES):
        body = ET.SubElement(body, "body", name=f"link_{i + 1}", pos=_words(PLACES[i]))
        joint = {"name": name, "axis": _words(AXES[i]), "range": _words(RANGES[i])}
        joint |= {key: f"{getattr(arm, key)[i]:.5g}" for key in ("frictionloss", "damping", "armature")}
        ET.SubElement(body, "joint", joint)
        ET.SubElement(
            body, "inertial", pos=_words(arm.centre[i]), mass=f"{arm.mass[i]:.5g}", diaginertia=_words(arm.inertia[i])
        )
    motors = ET.SubElement(root, "actuator")
    for name in NAMES:
        ET.SubElement(motors, "motor", name=f"{name}_motor", joint=name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _words(values: Float) -> str:
    return " ".join(f"{value:.5g}" for value in values)
