"""Frames of the robot's URDF in a simulator: the same arm, described with other frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.simulators.mujoco import Simulator
from cellwatt_plugins.robot import Body

POSES = 24
ASKEW = np.radians(2.0)
"""Largest angle between the axes of a joint, rad: a larger one means another zero or another arm."""
ASIDE = 0.03
"""Largest distance between the axes of a joint, m."""
ARM = 0.2
"""Lever, m, by which a distance between axes is converted to a share of torque."""
NOTED = (np.radians(0.1), 0.001)
"""Angle, rad, and distance, m, above which a note is given."""


@dataclass(frozen=True)
class Placing:
    """A simulator of n joints, and constant frames between it and the robot's URDF."""

    simulator: Simulator
    base: Float
    """(4, 4): the URDF's base in the simulator's world."""
    bodies: Float
    """(n, 4, 4): the simulator's bodies in the URDF's joint frames."""
    off: float = 0.0
    """Approximate share by which the torques of added terms differ between simulator and URDF."""
    notes: tuple[str, ...] = ()


def placing(simulator: Simulator, body: Body) -> Placing:
    """Match the axes of simulator and URDF in random poses. Raises ``ConfigError`` if they are not the same arm."""
    poses = np.vstack([np.zeros(body.joints), np.random.default_rng(0).uniform(-2, 2, (POSES, body.joints))])
    frames = body.forward(poses)
    axes = _along(frames[..., :3, :3], body.axes)
    theirs, anchors, directions = simulator.poses(poses)
    turn = _rotation(
        np.vstack([axes.reshape(-1, 3), _apart(frames[..., :3, 3], axes)]),
        np.vstack([directions.reshape(-1, 3), _apart(anchors, directions)]),
    )
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    points = frames[..., :3, 3] @ turn.T
    shift = np.linalg.lstsq(across.reshape(-1, 3), _along(across, anchors - points).ravel(), rcond=None)[0]
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = turn, shift
    askew = np.arccos(np.clip(np.sum((axes @ turn.T) * directions, axis=2), -1, 1)).max(axis=0)
    aside = np.linalg.norm(_along(across, anchors - points - shift), axis=2).max(axis=0)
    _check(simulator, askew, aside)
    inside = np.linalg.inv(base @ frames[0]) @ theirs[0]
    if np.max(askew) <= NOTED[0] and np.max(aside) <= NOTED[1]:
        return Placing(simulator, base, inside)
    note = (
        f"{simulator.path.name}: its axes differ from the URDF's by up to {np.degrees(np.max(askew)):.2f}° and "
        f"{1000 * np.max(aside):.1f} mm"
    )
    return Placing(simulator, base, inside, float(np.max(askew) + np.max(aside) / ARM), (note,))


def _check(simulator: Simulator, askew: Float, aside: Float) -> None:
    for joint, (angle, way) in enumerate(zip(askew, aside, strict=True)):
        if angle > ASKEW or way > ASIDE:
            raise ConfigError(
                f"{simulator.path}: the axis of {simulator.joints[joint]} differs from that of joint {joint + 1} of "
                f"the URDF by {np.degrees(angle):.0f}° and {1000 * way:.0f} mm: another zero, direction or arm"
            )


def _apart(points: Float, axes: Float) -> Float:
    """Vectors (K, 3) m from the first axis to axes always parallel to it, which directions do not determine."""
    parallel = np.all(np.abs(np.sum(axes * axes[:, :1], axis=2)) > np.cos(ASKEW), axis=0)
    ways = (points - points[:, :1])[:, parallel]
    own = axes[:, parallel]
    return np.asarray(ways - np.sum(ways * own, axis=2, keepdims=True) * own).reshape(-1, 3)


def _rotation(ours: Float, theirs: Float) -> Float:
    """The rotation (3, 3) that best turns directions ``ours`` (K, 3) into ``theirs`` (Kabsch 1976)."""
    left, _, right = np.linalg.svd(theirs.T @ ours)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _along(matrices: Float, vectors: Float) -> Float:
    return np.asarray(np.einsum("...ij,...j->...i", matrices, vectors))
