"""Arms in space: transforms of their joints from the encoders, and lines for their links."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Any, Final

from cellwatt.outlets.foxglove.topics import SCENE, TRANSFORMS, Outgoing, drawn_topic, own, stamp_of

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Final[Quaternion] = (0.0, 0.0, 0.0, 1.0)


def about(axis: Vector, angle: float) -> Quaternion:
    """The turn by ``angle`` rad about an axis of any length; no turn about an axis of length 0."""
    length = hypot(*axis)
    if not length:
        return IDENTITY
    x, y, z = (part / length * sin(angle / 2) for part in axis)
    return x, y, z, cos(angle / 2)


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation ``second``, then ``first``, both in the outer frame."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def of_rpy(rpy: Vector) -> Quaternion:
    """Roll, pitch and yaw in rad as URDF means them: about the fixed x, then y, then z."""
    roll, pitch, yaw = rpy
    return product(product(about((0, 0, 1), yaw), about((0, 1, 0), pitch)), about((1, 0, 0), roll))


def turned(rotation: Quaternion, vector: Vector) -> Vector:
    """A vector after a rotation."""
    x, y, z, w = rotation
    inverse = (-x, -y, -z, w)
    turned = product(product(rotation, (*vector, 0.0)), inverse)
    return turned[0], turned[1], turned[2]


def joint_pose(xyz: Vector, rpy: Vector, axis: Vector, kind: str, value: float) -> tuple[Vector, Quaternion]:
    """The place in m and the rotation of a joint's moving side within its parent's frame.

    ``value`` is in rad, for a ``prismatic`` joint in m; a ``fixed`` one has none.
    """
    fixed = of_rpy(rpy)
    if kind == "prismatic":
        length = hypot(*axis) or 1.0
        x, y, z = turned(fixed, (axis[0] / length * value, axis[1] / length * value, axis[2] / length * value))
        return (xyz[0] + x, xyz[1] + y, xyz[2] + z), fixed
    return xyz, fixed if kind == "fixed" else product(fixed, about(axis, value))


WORLD: Final = "world"
APART: Final = 1.5
"""m between the bases of arms whose places nobody told."""
_THICK: Final = 0.04
"""m: thickness of a link's line; its joint is a ball of twice that."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame stands in its parent: m, and a quaternion (x, y, z, w)."""

    frame: str
    parent: str
    place: Vector
    rotation: Quaternion


def joints_of(skeleton: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The joints of a skeleton, each with its ``frame`` ``<source>/<joint>`` and, as ``parent``, the one it sits in.

    The base is ``<source>/base``.
    """
    source, joints = skeleton["source"], skeleton["joints"]
    frames = [f"{source}/{joint['name']}" for joint in joints]
    parents = [*frames, f"{source}/base"]  # of the first joint the parent is -1
    return [
        {**joint, "frame": frame, "parent": parents[joint["parent"]]}
        for frame, joint in zip(frames, joints, strict=True)
    ]


def poses(joints: Iterable[Mapping[str, Any]], values: Mapping[str, float]) -> list[Pose]:
    """The poses of all joints whose values are known; one without a channel stands at 0."""
    found = []
    for joint in joints:
        value = 0.0
        if joint["channel"] is not None:
            value = values.get(joint["channel"], math.nan) * joint.get("multiplier", 1.0) + joint.get("offset", 0.0)
        if math.isfinite(value):
            place, rotation = joint_pose(joint["xyz"], joint["rpy"], joint["axis"], joint["type"], value)
            found.append(Pose(joint["frame"], joint["parent"], place, rotation))
    return found


class Arms:
    """The arms of a cell; they stand side by side, since the settings do not tell where."""

    def __init__(self, skeletons: Sequence[Mapping[str, Any]]) -> None:
        self._joints = [joint for skeleton in skeletons for joint in joints_of(skeleton)]
        self._bases = [
            Pose(f"{skeleton['source']}/base", WORLD, (0.0, APART * i, 0.0), IDENTITY)
            for i, skeleton in enumerate(skeletons)
        ]
        self._transforms = drawn_topic(TRANSFORMS, "FrameTransforms")
        self._scene = drawn_topic(SCENE, "SceneUpdate")

    def at(self, time: int, values: Mapping[str, float]) -> Outgoing:
        """The transforms at ``time``, UTC ns, for the channels' ``values`` in rad or m."""
        stamp = stamp_of(time)
        transforms = [
            own().FrameTransform(
                timestamp=stamp,
                parent_frame_id=pose.parent,
                child_frame_id=pose.frame,
                translation=own().Vector3(**_axes(pose.place)),
                rotation=own().Quaternion(**_axes(pose.rotation)),
            )
            for pose in (*self._bases, *poses(self._joints, values))
        ]
        return Outgoing(self._transforms, time, own().FrameTransforms(transforms=transforms).encode())

    def links(self, time: int) -> Outgoing:
        """Lines for the links; each moves with its joint's parent."""
        entities = [_link(joint, stamp_of(time)) for joint in self._joints]
        return Outgoing(self._scene, time, own().SceneUpdate(entities=entities).encode(), "links")


def _link(joint: Mapping[str, Any], stamp: Any) -> Any:
    """A line in the parent's frame from its origin to the joint, and a ball at the joint."""
    line = own().LinePrimitive(
        type=own().LinePrimitiveLineType.LineStrip,
        pose=_still((0.0, 0.0, 0.0)),
        thickness=_THICK,
        points=[own().Point3(x=0.0, y=0.0, z=0.0), own().Point3(**_axes(joint["xyz"]))],
        color=own().Color(r=0.45, g=0.5, b=0.56, a=1.0),
    )
    ball = own().SpherePrimitive(
        pose=_still(joint["xyz"]),
        size=own().Vector3(x=2 * _THICK, y=2 * _THICK, z=2 * _THICK),
        color=own().Color(r=0.9, g=0.45, b=0.1, a=1.0),
    )
    return own().SceneEntity(
        timestamp=stamp,
        frame_id=joint["parent"],
        id=joint["frame"],
        frame_locked=True,
        lines=[line],
        spheres=[ball],
    )


def _still(place: Vector) -> Any:
    return own().Pose(position=own().Vector3(**_axes(place)), orientation=own().Quaternion(**_axes(IDENTITY)))


def _axes(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyzw", values, strict=False))
