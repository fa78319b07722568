"""The description of an arm from a simulator's file, for users without a ``robot.yaml``."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cellwatt.errors import ConfigError
from cellwatt.logs.log import alike, numbered
from cellwatt_plugins.robot.body import read_urdf
from cellwatt_plugins.robot.description import Joint, RobotDescription
from cellwatt_plugins.robot.mjcf import compiled, is_mjcf, parents

SUFFIXES = (".xml", ".mjcf", ".urdf", ".xacro")


def is_simulator(path: Path) -> bool:
    """True if a file, by its name, is a simulator's model and not a table of its results."""
    return path.suffix.lower() in SUFFIXES


def described(path: Path, joints: int | Sequence[str] | None = None) -> RobotDescription:
    """The arm of an MJCF or URDF with its first ``joints`` (all if None), from the base; others are fixed.

    If ``joints`` are names, the arm has those that the file has, in the file's order.

    Rotors, friction and ranges are the file's. Raises ``ConfigError`` if it cannot be read or has no such arm.
    """
    try:
        return _of_mjcf(path, joints) if is_mjcf(path) else _of_urdf(path, joints)
    except ValueError as error:  # text that is not a number, or a number that no joint can have
        raise ConfigError(f"{path}: a joint has an impossible value: {' '.join(str(error).split())}") from error


def _of_mjcf(path: Path, joints: int | Sequence[str] | None) -> RobotDescription:
    model = compiled(path)
    found = []
    for name in _chain(path, parents(path, model), joints):
        number, dof = model.joint(name).id, model.joint(name).dofadr[0]
        low, high = model.jnt_range[number].tolist() if model.jnt_limited[number] else (None, None)
        found.append(
            Joint(
                name=name,
                rotor_inertia=float(model.dof_armature[dof]),
                coulomb_friction=float(model.dof_frictionloss[dof]),
                viscous_friction=float(model.dof_damping[dof]),
                lower_limit=low,
                upper_limit=high,
            )
        )
    return RobotDescription(robot=path.stem, urdf=path, joints=tuple(found), gravity=tuple(model.opt.gravity.tolist()))


def joints_in(path: Path) -> list[str]:
    """All joints of an MJCF or URDF that move, in the file's order, as simulators number them: a gripper's, too."""
    return list(parents(path, compiled(path)) if is_mjcf(path) else _above(*read_urdf(path)))


def _above(root: ET.Element, model: Any) -> dict[str, str | None]:
    """Each moving joint of a URDF, in the file's order, and the previous one towards the base; None for the first."""
    every = {joint.get("name", ""): joint for joint in root.findall("joint")}
    names = list(model.names)
    moving = [i for i in range(1, len(names)) if model.joints[i].nv == 1 and every[names[i]].find("mimic") is None]
    above: dict[str, str | None] = {}
    for i in moving:
        before = model.parents[i]
        while before and before not in moving:
            before = model.parents[before]
        above[names[i]] = names[before] if before else None
    return {name: above[name] for name in every if name in above}


def _of_urdf(path: Path, joints: int | Sequence[str] | None) -> RobotDescription:
    root, model = read_urdf(path)
    every = {joint.get("name", ""): joint for joint in root.findall("joint")}
    found = []
    for name in _chain(path, _above(root, model), joints):
        own = every[name].find("dynamics")
        friction, damping = (float(own.get(key, 0)) if own is not None else 0.0 for key in ("friction", "damping"))
        found.append(Joint(name=name, coulomb_friction=friction, viscous_friction=damping))
    return RobotDescription(robot=root.get("name", path.stem), urdf=path, joints=tuple(found))


def _row(above: Mapping[str, str | None], name: str) -> list[str]:
    """The joints from the base to one of them."""
    row = [name]
    while (before := above[row[0]]) is not None:
        row.insert(0, before)
    return row


def _chain(path: Path, above: Mapping[str, str | None], joints: int | Sequence[str] | None) -> list[str]:
    """The first ``joints`` of the longest chain of joints from the base; names: only joints of these.

    Names that differ in their numbers alone, none of which the file has, give the number of joints.
    """
    if joints is not None and not isinstance(joints, int):
        there = {name for name in above if any(alike(name, each) for each in joints)}
        known = {name: before for name, before in above.items() if there.issuperset(_row(above, name))}
        if not known and not numbered(joints):
            raise ConfigError(
                f"{path} has the joints {', '.join(above)}, the recording {', '.join(joints)}: use the same names"
            )
        above, joints = (known, None) if known else (above, len(joints))
    rows = [_row(above, name) for name in above]
    longest = max(rows, key=len, default=[])
    ends = [row for row in rows if row[-1] not in above.values()]  # of a gripper, one for each finger
    arm = [name for name in longest if all(name in row for row in ends)]
    of_hand = len(longest) - len(arm)  # a hand has fewer joints in a row than its arm; two arms have not
    if joints == len(above) > len(longest) and of_hand < len(arm) and list(above)[: len(arm)] == arm:
        joints = len(arm)
    if not longest:
        raise ConfigError(f"{path}: no joint with a name moves: give each hinge and slide a name")
    if joints is not None and len(longest) < joints:
        raise ConfigError(
            f"{path}: its longest chain of joints from the base is {', '.join(longest)}, the recording has {joints} "
            "joints: leave out the columns of other joints, as of a gripper"
        )
    count = len(longest) if joints is None else joints
    if others := {tuple(row[:count]) for row in rows if len(row) >= count} - {tuple(longest[:count])}:
        arms = " or ".join(", ".join(row) for row in sorted({tuple(longest[:count])} | others))
        raise ConfigError(
            f"{path}: several arms have {count} joints ({arms}): list the joints of the recording in robot.yaml"
        )
    return longest[:count]
