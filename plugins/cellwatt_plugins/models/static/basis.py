"""Quantities of each pose for the physics of held poses, computed once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot import Body, RobotDescription
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.load.gravity_tilt import level

PER_GRAVITY: Final = 4
"""Parameters of a link that gravity acts on: m and m·c (3)."""
BEYOND: Final = 1.1
"""Share of a joint's range beyond which the torques of springs and hoses are constant: no pose shows them there."""
COVERED: Final = 0.5
"""Smallest share of a stated range that poses must cover for the range to be used."""
_STEP: Final = 1e-4  # rad, for slopes over the joint angles


@dataclass(frozen=True)
class Basis:
    """N poses of an arm with n joints."""

    vertical: Float
    """(N, n, 4n): torques for one unit of each gravity parameter, g downwards; Nm."""
    sideways: Float
    """(2, N, n, 4n): the same for g along each level axis of the base, x and y of an arm that stands upright."""
    slopes: Float
    """(n, N, n, 4n): slope of ``vertical`` over each joint angle; Nm/rad."""
    share: Float
    """(N, n): joint angles, −1 … 1 within the joint's limits, clipped to ±``BEYOND``."""
    direction: Float
    """(N, n): −1, 0 or 1, the direction in which each joint came to the pose; 0 if unknown."""
    payload: Float
    """(N,): kg at the tool beside the arm's permanent load; 0 if unknown."""

    @classmethod
    def of(cls, body: Body, limits: Float, q: Float, direction: Float, payload: Float) -> Basis:
        """The basis of poses ``q`` (N, n) rad; ``limits`` (n, 2) rad, ``payload`` (N,) kg; NaN if unknown."""
        half = 0.5 * (limits[:, 1] - limits[:, 0])
        slopes = np.empty((body.joints, len(q), body.joints, PER_GRAVITY * body.joints))
        for joint in range(body.joints):
            step = np.zeros(body.joints)
            step[joint] = _STEP
            slopes[joint] = (_gravity(body, q + step) - _gravity(body, q - step)) / (2 * _STEP)
        aside = [_gravity(body, q, -np.eye(3)[axis]) for axis in level(body.gravity_field)]
        share = np.clip((q - limits.mean(axis=1)) / half, -BEYOND, BEYOND)
        return cls(_gravity(body, q), np.stack(aside), slopes, share, np.nan_to_num(direction), np.nan_to_num(payload))

    def rows(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Basis:
        """Some of the poses."""
        picked = {name: getattr(self, name)[which] for name in ("vertical", "share", "direction", "payload")}
        return replace(self, sideways=self.sideways[:, which], slopes=self.slopes[:, which], **picked)

    def __len__(self) -> int:
        return len(self.share)


def gravity_parameters(body: Body) -> Float:
    """m and m·c (3) of each link, (4n,): kg, kg m."""
    return body.parameters().reshape(-1, PER_LINK)[:, :PER_GRAVITY].reshape(-1)


def joint_limits(robot: RobotDescription, q: Float) -> Float:
    """Lowest and highest angle of each joint, (n, 2) rad: robot.yaml's, or those of the poses ``q`` (N, n).

    Poses that cover less than ``COVERED`` of a stated range do not show what a spring or hose does in the rest of it: a
    model of the whole range would be far worse where the poses are. The same holds for the URDF's ranges.
    """
    stated, visited = robot.limits, np.column_stack([q.min(axis=0), q.max(axis=0)])
    unseen = np.ptp(visited, axis=1) < COVERED * np.ptp(stated, axis=1)
    limits = np.where(np.isnan(stated) | unseen[:, None], visited, stated)
    flat = limits[:, 1] - limits[:, 0] < 1e-3
    return np.where(flat[:, None], limits.mean(axis=1)[:, None] + np.array([-0.5, 0.5]), limits)


def _gravity(body: Body, q: Float, along: Float | None = None) -> Float:
    """Regressor (N, n, 4n) of gravity's torques; ``along`` (3,) is the direction opposite to g, by default up."""
    if along is not None:
        body = body.with_gravity(-np.linalg.norm(body.gravity_field) * along)
    still = np.zeros_like(q)
    keep = (PER_LINK * np.arange(body.joints)[:, None] + np.arange(PER_GRAVITY)).reshape(-1)
    return body.regressor(q, still, still)[:, :, keep]
