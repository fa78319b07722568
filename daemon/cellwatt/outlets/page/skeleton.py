"""The joints of an arm, for its picture on the page: read from a URDF, each with the channel of its position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from pydantic import BaseModel

from cellwatt.config import read_settings
from cellwatt.errors import ConfigError, why
from cellwatt.files import read_bytes

MOST_JOINTS: Final = 500
_TYPES: Final[Mapping[str, str]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "fixed",
    "planar": "fixed",
}
"""Joint types of URDF; joints with several degrees of freedom are shown at rest."""


class _Named(BaseModel):
    name: str


class _Robot(BaseModel):
    """The keys of a robot.yaml that are used here."""

    urdf: Path
    joints: list[_Named]


@dataclass(frozen=True, slots=True)
class _Joint:
    """A joint between two links; ``shape`` is its JSON for the page, ``mimic`` the joint that it follows, if any."""

    name: str
    parent: str
    child: str
    mimic: str | None
    shape: Mapping[str, Any]

    @property
    def moves(self) -> bool:
        """True if the joint has its own position."""
        return self.shape["type"] != "fixed" and self.mimic is None


def skeleton(source: str, file: Path, channels: Sequence[str]) -> dict[str, Any]:
    """The joints of the arm that ``source`` measures, from the base, ready for JSON; m and rad.

    ``file`` is a URDF, a robot.yaml or the folder that contains one. The i-th joint of robot.yaml, or the i-th moving
    joint of a URDF, has the channel ``<source>.joint_<i>.position`` if it is in ``channels``. A mimic joint has the
    channel of the joint that it follows, with ``multiplier`` and ``offset``.

    Raises ``ConfigError`` with one line if the file cannot be used.
    """
    path = file / "robot.yaml" if file.is_dir() else file
    order: list[str] | None = None
    if path.suffix in (".yaml", ".yml", ".json"):
        robot = read_settings(path, _Robot)
        path, order = path.parent / robot.urdf, [joint.name for joint in robot.joints]
    try:
        joints = _from_base(_joints(path))
        moving = [joint.name for joint in joints if joint.moves]
        if missing := [name for name in order or () if name not in moving]:
            raise ValueError(f"no moving joint {', '.join(missing)}; there are {', '.join(moving) or 'none'}")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {why(error)}") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise ConfigError(f"{path}: cannot be used as a URDF: {error}") from error
    bound = {name: f"{source}.joint_{i}.position" for i, name in enumerate(order or moving, 1)}
    known = {name: channel for name, channel in bound.items() if channel in set(channels)}
    index_of = {joint.child: i for i, joint in enumerate(joints)}
    shown = [
        {
            **joint.shape,
            "parent": index_of.get(joint.parent, -1),
            "channel": None if joint.shape["type"] == "fixed" else known.get(joint.mimic or joint.name),
        }
        for joint in joints
    ]
    return {"source": source, "name": path.stem, "joints": shown}


def _from_base(joints: Sequence[_Joint]) -> list[_Joint]:
    """Joints sorted from the base, each after its parent. Raises ``ValueError`` if they are not a tree."""
    names, children = {joint.name: joint for joint in joints}, {joint.child for joint in joints}
    bases = {joint.parent for joint in joints} - children
    found: list[_Joint] = []
    waiting = [joint for joint in reversed(joints) if joint.parent in bases]
    while waiting and len(found) < len(joints):
        found.append(waiting.pop())
        waiting += [joint for joint in reversed(joints) if joint.parent == found[-1].child]
    if len(bases) != 1 or waiting or not len(found) == len(children) == len(names) == len(joints):
        raise ValueError(f"its joints are not one tree: {len(bases)} links have no parent, or a name occurs twice")
    for joint in found:
        if joint.mimic is not None and not (joint.mimic in names and names[joint.mimic].moves):
            raise ValueError(f"joint {joint.name!r} follows {joint.mimic!r}, which is not a moving joint")
    return found


# URDF -----------------------------------------------------------------------------------------------


class _Tree(ElementTree.TreeBuilder):
    """Refuses entity declarations, as a few can expand to gigabytes."""

    def doctype(self, *_: str | None) -> None:
        raise ValueError("a URDF has no DOCTYPE")


def _joints(path: Path) -> list[_Joint]:
    """All joints of a URDF, in file order.

    Raises ``OSError``, and ``ParseError``, ``LookupError`` or ``ValueError`` if it is not a URDF.
    """
    parser = ElementTree.XMLParser(target=_Tree())
    parser.feed(read_bytes(path))
    root = parser.close()
    found = root.findall("joint") if root.tag == "robot" else []
    if not 0 < len(found) <= MOST_JOINTS:
        raise ValueError(f"{len(found) or 'no'} joint in <robot>, 1 to {MOST_JOINTS} can be shown")
    return [_joint(element) for element in found]


def _joint(element: ElementTree.Element) -> _Joint:
    name, type_ = element.get("name", ""), element.get("type", "")
    parent, child = (_attribute(element, tag, "link") for tag in ("parent", "child"))
    if not (name and parent and child and type_ in _TYPES):
        raise ValueError(f"joint {name!r} lacks its type, its parent or its child")
    try:
        axis = _vector(_attribute(element, "axis", "xyz") or "1 0 0")
        length = math.hypot(*axis)
        if type_ != "fixed" and not length:
            raise ValueError("its axis has no direction")
        shape: dict[str, Any] = {
            "name": name,
            "type": _TYPES[type_],
            "xyz": _vector(_attribute(element, "origin", "xyz") or "0 0 0"),
            "rpy": _vector(_attribute(element, "origin", "rpy") or "0 0 0"),
            "axis": [part / length for part in axis] if length else axis,
        }
        mimic = _attribute(element, "mimic", "joint")
        if mimic is not None:
            shape["multiplier"] = _number(_attribute(element, "mimic", "multiplier") or "1")
            shape["offset"] = _number(_attribute(element, "mimic", "offset") or "0")
    except ValueError as error:
        raise ValueError(f"joint {name!r}: {error}") from error
    return _Joint(name, parent, child, mimic, shape)


def _attribute(element: ElementTree.Element, tag: str, name: str) -> str | None:
    child = element.find(tag)
    return None if child is None else child.get(name)


def _vector(text: str) -> list[float]:
    values = [_number(word) for word in text.split()]
    if len(values) != 3:
        raise ValueError(f"{text!r} is not three numbers")
    return values


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number (convert a xacro to a URDF first)") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number")
    return value
