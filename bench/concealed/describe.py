"""An arm as URDF and robot.yaml for the product, and as MJCF for the plant, from one description."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection
from typing import Any

import numpy as np
import yaml

from concealed.arms import Arm, Array

TIMESTEP = 0.0005


def words(values: Array | tuple[float, ...]) -> str:
    """Numbers as an XML attribute, to nine digits."""
    return " ".join(f"{v:.9g}" for v in values)


def urdf(arm: Arm) -> str:
    """The arm as URDF: link frames at their joints, all at zero rotation."""
    robot = ET.Element("robot", name=arm.family)
    ET.SubElement(robot, "link", name="base")
    for j in range(arm.joints):
        link = ET.SubElement(robot, "link", name=f"link_{j + 1}")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=words(arm.com[j]), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=f"{arm.mass[j]:.9g}")
        ixx, iyy, izz = (f"{v:.9g}" for v in arm.inertia[j])
        ET.SubElement(inertial, "inertia", ixx=ixx, ixy="0", ixz="0", iyy=iyy, iyz="0", izz=izz)
        joint = ET.SubElement(robot, "joint", name=f"joint_{j + 1}", type="revolute")
        ET.SubElement(joint, "parent", link=f"link_{j}" if j else "base")
        ET.SubElement(joint, "child", link=f"link_{j + 1}")
        ET.SubElement(joint, "origin", xyz=words(arm.origins[j]), rpy="0 0 0")
        ET.SubElement(joint, "axis", xyz=words(arm.axes[j]))
        ET.SubElement(joint, "limit", lower="-6.2832", upper="6.2832", effort="2000", velocity="10")
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


MAY_BE_ABSENT = ("rotor_inertia", "coulomb_friction", "viscous_friction", "winding_resistance", "standby_power")


def robot_yaml(arm: Arm, rate: float, leave_out: bool = False) -> str:
    """What is known of the drives, as the contract of `explain` names it; keys of value 0 may be left out."""
    joints: list[dict[str, Any]] = [
        {
            "name": f"joint_{j + 1}",
            "gear_ratio": float(arm.gear[j]),
            "torque_constant": round(float(arm.constant[j]), 6),
            "rotor_inertia": round(float(arm.rotor[j]), 6),
            "coulomb_friction": round(float(arm.coulomb[j]), 6),
            "viscous_friction": round(float(arm.viscous[j]), 6),
            "winding_resistance": round(float(arm.resistance[j]), 6),
        }
        for j in range(arm.joints)
    ]
    content: dict[str, Any] = {
        "robot": arm.family,
        "urdf": "robot.urdf",
        "sample_rate": rate,
        "joints": joints,
        "standby_power": round(float(arm.standby), 4),
    }
    if leave_out:
        for part in (content, *joints):
            for key in MAY_BE_ABSENT:
                if part.get(key) == 0:
                    del part[key]
    return yaml.safe_dump(content, sort_keys=False)


def mjcf(
    arm: Arm, copies: int, elastic: Collection[int] = (), armature: bool = True, timestep: float = TIMESTEP
) -> str:
    """`copies` of the arm as separate trees of one MuJoCo model without contacts.

    Joint `m{copy}_{j}` is the motor; an elastic joint j has a second hinge `e{copy}_{j}` on the same axis between
    motor and link. Body `p{copy}` at the flange has no mass until the plant gives it one.
    """
    root = ET.Element("mujoco", model=arm.family)
    ET.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = ET.SubElement(root, "option", timestep=f"{timestep:.9g}", integrator="implicitfast", gravity="0 0 -9.81")
    ET.SubElement(option, "flag", contact="disable", constraint="disable")
    world = ET.SubElement(root, "worldbody")
    for c in range(copies):
        body = world
        for j in range(arm.joints):
            body = ET.SubElement(body, "body", name=f"l{c}_{j}", pos=words(arm.origins[j]))
            hinge = {"type": "hinge", "axis": words(arm.axes[j])}
            ET.SubElement(body, "joint", hinge, name=f"m{c}_{j}", armature=f"{arm.rotor[j] if armature else 0.0:.9g}")
            if j in elastic:
                ET.SubElement(body, "joint", hinge, name=f"e{c}_{j}")
            ET.SubElement(
                body,
                "inertial",
                pos=words(arm.com[j]),
                mass=f"{arm.mass[j]:.9g}",
                diaginertia=words(np.asarray(arm.inertia[j])),
            )
        flange = ET.SubElement(body, "body", name=f"p{c}", pos=words(arm.flange))
        # Not at the frame's origin: MuJoCo then keeps reading the place from the model, where the plant changes it.
        ET.SubElement(flange, "inertial", pos="0.01 0.01 0.01", mass="0", diaginertia="0 0 0")
    return ET.tostring(root, encoding="unicode")
