"""Rotations as quaternions (x, y, z, w). Pure."""

from __future__ import annotations

from math import cos, hypot, sin
from typing import Final

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
