"""A MuJoCo file as MuJoCo compiles it: its arm as a URDF, and the data of its joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.files import WRITTEN, check_file, read_bytes

LEAST_INERTIA = "1e-9"
"""Inertia, kg m², of a link of a URDF that states a mass without any: MuJoCo refuses points."""
ANYWHERE = 1e3
"""Range in m, each way from 0, of a slide joint without a range: a URDF must state one."""


def is_mjcf(path: Path) -> bool:
    """True if a file, by its name, is an MJCF file and not a URDF."""
    return path.suffix.lower() in (".xml", ".mjcf")


def compiled(path: Path) -> Any:
    """``mujoco.MjModel`` of an MJCF or URDF. Raises ``ConfigError`` where the extra is missing or it cannot be read."""
    mujoco = library(path)
    try:
        if is_mjcf(path):
            check_file(path, WRITTEN)
            model = mujoco.MjModel.from_xml_path(str(path))
        else:
            model = mujoco.MjModel.from_xml_string(_without_shapes(read_bytes(path)))
        if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            model.opt.gravity[:] = 0.0
        return model
    except (OSError, UnicodeDecodeError, ET.ParseError, ValueError) as error:
        raise ConfigError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error


def library(path: Path) -> Any:
    """The module ``mujoco``. Raises ``ConfigError`` that names the extra where it is not installed."""
    try:
        import mujoco
    except ImportError as error:
        raise ConfigError(f'{path}: needs MuJoCo: pip install "cellwatt[simulators]"') from error
    return mujoco


def scalar_types(path: Path) -> tuple[int, int]:
    """MuJoCo's types of joints with one coordinate: hinge and slide."""
    types = library(path).mjtJoint
    return int(types.mjJNT_HINGE), int(types.mjJNT_SLIDE)


def parents(path: Path, model: Any) -> dict[str, str | None]:
    """Each named hinge or slide joint, and the previous one towards the base; None for the first."""
    last: dict[int, str | None] = {0: None}
    found: dict[str, str | None] = {}
    for body in range(1, model.nbody):
        above = last[int(model.body_parentid[body])]
        for number in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            joint = model.joint(number)
            if joint.name and joint.type[0] in scalar_types(path):
                found[joint.name] = above
                above = joint.name
        last[body] = above
    return found


def urdf_of(path: Path, joints: Sequence[str]) -> str:
    """The arm of ``joints`` as a URDF, the bodies' frames at the joints; other joints are at their reference position.

    Raises ``ConfigError`` where it cannot be read, or a joint is missing.
    """
    model = compiled(path)
    data = library(path).MjData(model)
    known = parents(path, model)
    if missing := [name for name in joints if name not in known]:
        raise ConfigError(f"{path}: no joint {', '.join(missing)}; its hinges and slides are {', '.join(known)}")
    if len({int(model.joint(name).bodyid[0]) for name in joints}) < len(joints):
        raise ConfigError(f"{path}: two joints move the same body: give each joint a body of its own")
    for name in joints:
        data.qpos[model.joint(name).qposadr[0]] = 0.0
    library(path).mj_kinematics(model, data)
    root = ET.Element("robot", name=model.names[: model.names.index(b"\0")].decode() or path.stem)
    ET.SubElement(root, "link", name="base")
    frame, before = np.eye(4), "base"
    for at, name in enumerate(joints):
        placement = np.eye(4)
        number, body = model.joint(name).id, int(model.joint(name).bodyid[0])
        placement[:3, :3], placement[:3, 3] = data.xmat[body].reshape(3, 3), data.xanchor[number]
        link = f"link_{at + 1}"
        _add_joint(root, model, name, before, link, _seen_from(frame, placement))
        _add_link(root, model, data, link, placement, _carried(model, joints, at))
        frame, before = placement, link
    return ET.tostring(root, encoding="unicode")


def _carried(model: Any, joints: Sequence[str], at: int) -> Iterator[int]:
    """Bodies that joint number ``at`` (0-based) moves and no later joint does."""
    moving = {int(model.joint(name).bodyid[0]): i for i, name in enumerate(joints)}
    owner = {0: -1}
    for body in range(1, model.nbody):
        owner[body] = moving.get(body, owner[int(model.body_parentid[body])])
        if owner[body] == at:
            yield body


def _add_joint(root: ET.Element, model: Any, name: str, parent: str, child: str, placement: Float) -> None:
    number = model.joint(name).id
    slides = model.jnt_type[number] == 2
    joint = ET.SubElement(root, "joint", name=name, type="prismatic" if slides else "revolute")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _add_origin(joint, placement)
    ET.SubElement(joint, "axis", xyz=_numbers(model.jnt_axis[number]))
    low, high = (
        model.jnt_range[number] if model.jnt_limited[number] else (-ANYWHERE, ANYWHERE) if slides else (0.0, 0.0)
    )
    force = model.jnt_actfrcrange[number, 1] if model.jnt_actfrclimited[number] else 0.0
    ET.SubElement(
        joint, "limit", lower=repr(float(low)), upper=repr(float(high)), effort=repr(float(force)), velocity="0"
    )


def _add_link(root: ET.Element, model: Any, data: Any, name: str, frame: Float, bodies: Iterator[int]) -> None:
    """One link, and one fixed to it for each further body, each with its inertia about its own centre of mass."""
    for i, body in enumerate(bodies):
        own = name if i == 0 else f"{name}_{i + 1}"
        link = ET.SubElement(root, "link", name=own)
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = data.ximat[body].reshape(3, 3), data.xipos[body]
        placement = _seen_from(frame, placement)
        if model.body_mass[body] > 0:
            inertial = ET.SubElement(link, "inertial")
            _add_origin(inertial, placement)
            ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[body])))
            x, y, z = map(repr, model.body_inertia[body].tolist())
            ET.SubElement(inertial, "inertia", ixx=x, iyy=y, izz=z, ixy="0", ixz="0", iyz="0")
        if i:
            joint = ET.SubElement(root, "joint", name=f"{own}_fixed", type="fixed")
            ET.SubElement(joint, "parent", link=name)
            ET.SubElement(joint, "child", link=own)


def _seen_from(frame: Float, placement: Float) -> Float:
    return np.asarray(np.linalg.inv(frame) @ placement, np.float64)


def _add_origin(element: ET.Element, placement: Float) -> None:
    turn = pin.rpy.matrixToRpy(placement[:3, :3])
    ET.SubElement(element, "origin", xyz=_numbers(placement[:3, 3]), rpy=_numbers(turn))


def _numbers(values: Float) -> str:
    return " ".join(repr(float(value)) for value in values)


def _without_shapes(urdf: bytes) -> str:
    """A URDF without visual and collision shapes, whose mesh files are often missing. Each link is a body."""
    root = ET.fromstring(urdf.lstrip())
    for link in root.iter("link"):
        for shape in [child for child in link if child.tag in ("visual", "collision")]:
            link.remove(shape)
    own = root.find("mujoco")
    own = ET.SubElement(root, "mujoco") if own is None else own
    compiler = own.find("compiler")
    compiler = ET.SubElement(own, "compiler") if compiler is None else compiler
    compiler.set("fusestatic", "false")
    compiler.set("boundinertia", compiler.get("boundinertia", LEAST_INERTIA))
    return ET.tostring(root, encoding="unicode")
