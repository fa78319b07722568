"""The joints of an arm for the page's picture of it: read from a URDF, each bound to the channel of its position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal
from xml.etree import ElementTree

from pydantic import BaseModel

from cellwatt.config import read_settings
from cellwatt.errors import ConfigError, why
from cellwatt.files import read_bytes

MOST_JOINTS: Final = 500
_TYPES: Final[Mapping[str, Literal["revolute", "prismatic", "fixed"]]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "fixed",
    "planar": "fixed",
}
"""Types of URDF; what moves in several directions is shown at rest."""

Vector = tuple[float, float, float]


class _Named(BaseModel):
    name: str


class _Robot(BaseModel):
    """The part of a robot.yaml that is needed here."""

    urdf: Path
    joints: list[_Named]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of a URDF between two links. It follows another where ``mimic`` names one."""

    name: str
    type: Literal["revolute", "prismatic", "fixed"]
    parent: str
    child: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    mimic: str | None = None
    multiplier: float = 1.0
    offset: float = 0.0

    @property
    def moves(self) -> bool:
        """True where it has a position of its own."""
        return self.type != "fixed" and self.mimic is None


def skeleton(source: str, file: Path, channels: Sequence[str]) -> dict[str, Any]:
    """The joints of the arm that ``source`` measures, from the base, JSON-ready; m and rad.

    ``file`` is a URDF, a robot.yaml or the folder that holds one. The i-th joint of robot.yaml, or the i-th that moves
    in a URDF, has the channel ``<source>.joint_<i>.position`` if that is in ``channels``. One that follows another has
    the other's channel, with ``multiplier`` and ``offset``.

    Raises ``ConfigError`` with one line where the file cannot be used.
    """
    path = file / "robot.yaml" if file.is_dir() else file
    order: list[str] | None = None
    if path.suffix in (".yaml", ".yml", ".json"):
        robot = read_settings(path, _Robot)
        path, order = path.parent / robot.urdf, [joint.name for joint in robot.joints]
    joints = from_base(path, read_urdf(path))
    moving = [joint.name for joint in joints if joint.moves]
    if missing := [name for name in order or () if name not in moving]:
        raise ConfigError(f"{path}: no moving joint {', '.join(missing)}; there are {', '.join(moving) or 'none'}")
    bound = {name: f"{source}.joint_{i}.position" for i, name in enumerate(order or moving, 1)}
    known = {name: channel for name, channel in bound.items() if channel in set(channels)}
    return {"source": source, "name": path.stem, "joints": list(_told(joints, known))}


def _told(joints: Sequence[Joint], channels: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    place = {joint.child: i for i, joint in enumerate(joints)}
    for joint in joints:
        told = {
            "name": joint.name,
            "parent": place.get(joint.parent, -1),
            "xyz": list(joint.xyz),
            "rpy": list(joint.rpy),
            "axis": list(joint.axis),
            "type": joint.type,
            "channel": channels.get(joint.mimic or joint.name) if joint.type != "fixed" else None,
        }
        if joint.mimic is not None:
            told |= {"multiplier": joint.multiplier, "offset": joint.offset}
        yield told


def from_base(path: Path, joints: Sequence[Joint]) -> list[Joint]:
    """Joints in order from the base, each behind the one that it hangs on.

    Raises ``ConfigError`` where they are no tree.
    """
    children = {joint.child for joint in joints}
    bases = {joint.parent: None for joint in joints if joint.parent not in children}
    if len(children) < len(joints):
        raise ConfigError(f"{path}: two joints hold the same link")
    if len(bases) != 1:
        raise ConfigError(f"{path}: its joints are not one tree: {len(bases)} links hang on nothing")
    below: dict[str, list[Joint]] = {}
    for joint in reversed(joints):
        below.setdefault(joint.parent, []).append(joint)
    found: list[Joint] = []
    waiting = list(below.get(next(iter(bases)), ()))
    while waiting:
        found.append(waiting.pop())
        waiting += below.get(found[-1].child, ())
    if len(found) < len(joints):
        raise ConfigError(f"{path}: some of its joints hang on each other in a ring")
    names = {joint.name: joint for joint in found}
    for joint in found:
        if joint.mimic is not None and not (joint.mimic in names and names[joint.mimic].moves):
            raise ConfigError(f"{path}: joint {joint.name!r} follows {joint.mimic!r}, which is no joint that moves")
    return found


# URDF -----------------------------------------------------------------------------------------------


class _Tree(ElementTree.TreeBuilder):
    """Refuses declarations of entities, of which a few can stand for gigabytes."""

    def doctype(self, *_: str | None) -> None:
        raise ValueError("a URDF has no DOCTYPE")


def read_urdf(path: Path) -> list[Joint]:
    """All joints of a URDF, as they stand in it. Raises ``ConfigError`` where it cannot be read or has none."""
    try:
        parser = ElementTree.XMLParser(target=_Tree())
        parser.feed(read_bytes(path))
        root = parser.close()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {why(error)}") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last: an encoding that there is not
        raise ConfigError(f"{path}: cannot be read as a URDF: {error}") from error
    found = [_joint(path, element) for element in root.findall("joint")] if root.tag == "robot" else []
    if not found:
        raise ConfigError(f"{path}: cannot be read as a URDF: no joint in <robot>")
    if len(found) > MOST_JOINTS:
        raise ConfigError(f"{path}: {len(found)} joints, at most {MOST_JOINTS} can be shown")
    if len({joint.name for joint in found}) < len(found):
        raise ConfigError(f"{path}: two joints have the same name")
    return found


def _joint(path: Path, element: ElementTree.Element) -> Joint:
    name, type_ = element.get("name", ""), element.get("type", "")
    parent, child = (_attribute(element, tag, "link") for tag in ("parent", "child"))
    if not (name and parent and child and type_ in _TYPES):
        raise ConfigError(f"{path}: joint {name!r} lacks its type, its parent or its child")
    try:
        axis = _vector(_attribute(element, "axis", "xyz") or "1 0 0")
        length = math.hypot(*axis)
        if type_ != "fixed" and not length:
            raise ValueError("its axis has no direction")
        return Joint(
            name=name,
            type=_TYPES[type_],
            parent=parent,
            child=child,
            xyz=_vector(_attribute(element, "origin", "xyz") or "0 0 0"),
            rpy=_vector(_attribute(element, "origin", "rpy") or "0 0 0"),
            axis=(axis[0] / length, axis[1] / length, axis[2] / length) if length else axis,
            mimic=_attribute(element, "mimic", "joint"),
            multiplier=_number(_attribute(element, "mimic", "multiplier") or "1"),
            offset=_number(_attribute(element, "mimic", "offset") or "0"),
        )
    except ValueError as error:
        raise ConfigError(f"{path}: joint {name!r}: {error}") from error


def _attribute(element: ElementTree.Element, tag: str, name: str) -> str | None:
    child = element.find(tag)
    return None if child is None else child.get(name)


def _vector(text: str) -> Vector:
    values = [_number(word) for word in text.split()]
    if len(values) != 3:
        raise ValueError(f"{text!r} is not three numbers")
    return values[0], values[1], values[2]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number (of a xacro, make the URDF first)") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is no finite number")
    return value
