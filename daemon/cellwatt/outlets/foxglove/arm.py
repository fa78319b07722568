"""Arms in space: transforms of their joints from the encoders, and lines for their links."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from math import cos, sin
from typing import Any, Final

from cellwatt.outlets.foxglove.topics import SCENE, TRANSFORMS, Outgoing, drawn_topic, own, stamp_of

Vector = Sequence[float]

IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)
"""No turn: quaternions are (x, y, z, w)."""
WORLD: Final = "world"
APART: Final = 1.5
"""m between the bases of arms whose places nobody told."""
_THICK: Final = 0.04
"""m: thickness of a link's line; its joint is a ball of twice that."""


def of_rpy(rpy: Vector) -> Vector:
    """The quaternion of roll, pitch and yaw in rad as URDF means them: about the fixed x, then y, then z."""
    (sr, sp, sy), (cr, cp, cy) = (sin(a / 2) for a in rpy), (cos(a / 2) for a in rpy)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def moved(joint: Mapping[str, Any], values: Mapping[str, float]) -> tuple[Vector, Vector] | None:
    """The place in m and the rotation of a joint's moving side in its origin; None while its value is not known.

    One without a channel stands at 0.
    """
    value = 0.0
    if joint["channel"] is not None:
        value = values.get(joint["channel"], math.nan) * joint.get("multiplier", 1.0) + joint.get("offset", 0.0)
    if not math.isfinite(value):
        return None
    along, turn = (value, 0.0) if joint["type"] == "prismatic" else (0.0, value)
    x, y, z = (sin(turn / 2) * part for part in joint["axis"])
    return [along * part for part in joint["axis"]], (x, y, z, cos(turn / 2))


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


class Arms:
    """The arms of a cell; they stand side by side, since the settings do not tell where.

    A joint has two frames: ``<frame>/origin``, where its URDF puts it in its parent, and in it the side that moves.
    """

    def __init__(self, skeletons: Sequence[Mapping[str, Any]]) -> None:
        self._joints = [joint for skeleton in skeletons for joint in joints_of(skeleton)]
        self._still: list[tuple[str, str, Vector, Vector]] = [
            (WORLD, f"{skeleton['source']}/base", (0.0, APART * i, 0.0), IDENTITY)
            for i, skeleton in enumerate(skeletons)
        ]
        self._still += [(j["parent"], f"{j['frame']}/origin", j["xyz"], of_rpy(j["rpy"])) for j in self._joints]
        self._transforms = drawn_topic(TRANSFORMS, "FrameTransforms")
        self._scene = drawn_topic(SCENE, "SceneUpdate")

    def at(self, time: int, values: Mapping[str, float]) -> Outgoing:
        """The transforms at ``time``, UTC ns, for the channels' ``values`` in rad or m."""
        moves = ((joint["frame"], moved(joint, values)) for joint in self._joints)
        poses = [*self._still, *((f"{frame}/origin", frame, *pose) for frame, pose in moves if pose is not None)]
        stamp = stamp_of(time)
        transforms = [
            own().FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=frame,
                translation=own().Vector3(**_axes(place)),
                rotation=own().Quaternion(**_axes(rotation)),
            )
            for parent, frame, place, rotation in poses
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


def _axes(values: Vector) -> dict[str, float]:
    return dict(zip("xyzw", values, strict=False))
