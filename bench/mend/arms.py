"""Which arms are mended, what each has that its MJCF lacks, and that MJCF as a person would write it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from concealed.arms import Arm, Array
from concealed.cases import Spec, build, generator
from concealed.describe import words
from concealed.record import Key, write_case
from concealed.setting import NotVisibleError

SEED = "mended simulators"


@dataclass(frozen=True)
class Case:
    """An arm with its effects and their strength."""

    name: str
    effects: tuple[tuple[str, str], ...]


CASES = (
    Case(
        "payload-spring-stribeck", (("payload", "strong"), ("spring_load", "medium"), ("stribeck_friction", "strong"))
    ),
    Case(
        "tilt-armature-load",
        (("gravity_tilt", "medium"), ("rotor_inertia", "medium"), ("load_dependent_friction", "strong")),
    ),
    Case(
        "friction-damping-ripple",
        (("coulomb_friction", "strong"), ("viscous_friction", "medium"), ("position_periodic_torque", "strong")),
    ),
    Case("numbers-off", ()),
)
"""Three of each kind that MuJoCo's files can and cannot say; the last lacks nothing, its numbers are off."""


@dataclass(frozen=True)
class Drawn:
    """A case as files in ``folder`` (open) and ``sealed``, and the truth."""

    case: Case
    folder: Path
    sealed: Path
    truth: Arm
    believed: Arm
    key: Key


def draw(case: Case, work: Path) -> Drawn:
    """Draw an arm with the case's effects, run the plant, write recordings, robot.yaml and the user's arm.xml."""
    spec = Spec("mend", case.effects, "short")
    for attempt in range(200):
        rng = generator(SEED, case.name, attempt)
        try:
            setting, effects = build(rng, spec)
            key = write_case(setting, effects, "mend", case.name, work)
        except NotVisibleError:
            continue
        folder = work / "dev" / case.name
        (folder / "arm.xml").write_text(mjcf(rng, setting.believed))
        return Drawn(case, folder, work / "keys" / case.name, setting.base, setting.believed, key)
    raise NotVisibleError(f"{case.name} shows with no arm in 200 draws")


def turned(rng: np.random.Generator) -> Array:
    """A rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def quaternion(turn: Array) -> Array:
    """w, x, y, z of a rotation (3, 3)."""
    w = 0.5 * np.sqrt(max(0.0, 1 + np.trace(turn)))
    if w < 1e-3:
        raise NotVisibleError("half a turn")
    x = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (4 * w)
    return np.concatenate([[w], x])


def mjcf(rng: np.random.Generator, arm: Arm) -> str:
    """What the user has of the arm: bodies with frames of their own, joints by the URDF's names, motors."""
    root = ET.Element("mujoco", model=arm.family)
    root.append(ET.Comment(" drawn by hand "))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", timestep="0.002", integrator="implicitfast", gravity="0 0 -9.81")
    default = ET.SubElement(ET.SubElement(root, "default"), "default", {"class": "axis"})
    ET.SubElement(default, "joint", type="hinge", damping="0", armature="0")
    body = ET.SubElement(root, "worldbody")
    above, place = np.eye(3), np.zeros(3)
    for j in range(arm.joints):
        turn, shift = turned(rng), rng.uniform(-0.1, 0.1, 3)
        # The body's frame lies at ``shift`` in the URDF's link frame, turned; the one above likewise.
        body = ET.SubElement(
            body,
            "body",
            name=f"part_{j + 1}",
            pos=words(above.T @ (arm.origins[j] + shift - place)),
            quat=words(quaternion(above.T @ turn)),
        )
        ET.SubElement(
            body,
            "joint",
            {"class": "axis"},
            name=f"joint_{j + 1}",
            pos=words(-turn.T @ shift),
            axis=words(turn.T @ arm.axes[j]),
            frictionloss=f"{arm.coulomb[j]:.6g}",
            damping=f"{arm.viscous[j]:.6g}",
            armature=f"{arm.rotor[j]:.6g}",
        )
        ET.SubElement(
            body,
            "inertial",
            pos=words(turn.T @ (arm.com[j] - shift)),
            quat=words(quaternion(turn.T)),
            mass=f"{arm.mass[j]:.9g}",
            diaginertia=words(np.asarray(arm.inertia[j])),
        )
        above, place = turn, shift
    motors = ET.SubElement(root, "actuator")
    for j in range(arm.joints):
        ET.SubElement(motors, "motor", name=f"motor_{j + 1}", joint=f"joint_{j + 1}")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
