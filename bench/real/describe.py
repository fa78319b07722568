"""What the product is told of an arm: ``robot.yaml`` and ``robot.urdf`` in a folder of their own."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from real.recording import Float


@dataclass(frozen=True)
class Link:
    """Mass kg, centre of mass m in the link's frame, inertia kg m² about it: xx, xy, xz, yy, yz, zz."""

    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Drives:
    """Per joint (n,), at the joint side; 0 where the description leaves a term out."""

    coulomb: Float
    viscous: Float
    rotor: Float
    gain: Float
    """Nm/A."""
    gear: float = 1.0
    gain_doubt: float | None = None
    """How far all gains may be off together, as a share; None: the product's own assumption."""


def nothing(joints: int, gain: Float | None = None, gear: float = 1.0) -> Drives:
    """Drives of which only the gains are known."""
    zero = np.zeros(joints)
    return Drives(zero, zero, zero, zero if gain is None else gain, gear)


def write_robot(folder: Path, name: str, joints: Sequence[str], urdf: str, drives: Drives, rate: float) -> Path:
    """Write both files; returns the path of robot.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf)
    listed = [
        {
            "name": joint,
            "gear_ratio": drives.gear,
            "torque_constant": round(float(drives.gain[j]), 6),
            "rotor_inertia": round(float(drives.rotor[j]), 6),
            "coulomb_friction": round(float(drives.coulomb[j]), 6),
            "viscous_friction": round(float(drives.viscous[j]), 6),
            "winding_resistance": 0.0,
        }
        for j, joint in enumerate(joints)
    ]
    content: dict[str, object] = {
        "robot": name,
        "urdf": "robot.urdf",
        "sample_rate": rate,
        "joints": listed,
        "standby_power": 0.0,
    }
    if drives.gain_doubt is not None:
        content["tolerances"] = {"torque_gain": drives.gain_doubt}
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def chain(name: str, joints: Sequence[str], frames: Sequence[tuple[float, float, float]], links: Sequence[Link]) -> str:
    """URDF of a serial arm from modified Denavit-Hartenberg frames (a m, alpha rad, d m)."""
    robot = ET.Element("robot", name=name)
    ET.SubElement(robot, "link", name="link_0")
    for i, (joint, (a, alpha, d), link) in enumerate(zip(joints, frames, links, strict=True), start=1):
        element = ET.SubElement(robot, "link", name=f"link_{i}")
        _inertial(element, link)
        element = ET.SubElement(robot, "joint", name=joint, type="revolute")
        ET.SubElement(element, "parent", link=f"link_{i - 1}")
        ET.SubElement(element, "child", link=f"link_{i}")
        origin = (a, -d * np.sin(alpha), d * np.cos(alpha))
        ET.SubElement(element, "origin", xyz=_words(origin), rpy=_words((alpha, 0.0, 0.0)))
        ET.SubElement(element, "axis", xyz="0 0 1")
        ET.SubElement(element, "limit", lower="-6.2832", upper="6.2832", effort="1000", velocity="10")
    return ET.tostring(robot, encoding="unicode")


def with_links(urdf: str, joints: Sequence[str], links: Sequence[Link]) -> str:
    """The URDF with the inertial parameters of the links that ``joints`` move, frames as in the URDF."""
    robot = ET.fromstring(urdf)
    moved = {
        joint.get("name"): child.get("link") for joint in robot.findall("joint") for child in joint.findall("child")
    }
    bodies = {link.get("name"): link for link in robot.findall("link")}
    for joint, link in zip(joints, links, strict=True):
        element = bodies[moved[joint]]
        for old in element.findall("inertial"):
            element.remove(old)
        _inertial(element, link)
    return ET.tostring(robot, encoding="unicode")


def _inertial(parent: ET.Element, link: Link) -> None:
    inertial = ET.SubElement(parent, "inertial")
    ET.SubElement(inertial, "origin", xyz=_words(link.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=f"{link.mass:.9g}")
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = {name: f"{value:.9g}" for name, value in zip(names, link.inertia, strict=True)}
    ET.SubElement(inertial, "inertia", values)


def _words(values: Sequence[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
