"""A serial arm as plain numbers: the data of its URDF that a model file contains."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import Body
from cellwatt_plugins.robot.body import PER_LINK


@dataclass(frozen=True)
class Chain:
    """Revolute joints in series, each with the link that it moves."""

    placements: Float
    """(n, 4, 4): each joint's frame in the frame of the previous joint, at angle 0; m."""
    axes: Float
    """(n, 3): unit vectors in the joints' own frames."""
    inertial: Float
    """(n, 10): m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz of each link about its joint's frame; kg, m."""
    gravity: Float
    """(3,) m/s² in the base's frame."""

    @classmethod
    def of(cls, body: Body) -> Chain:
        """The chain of an arm. Raises ``ConfigError`` if a joint is not revolute."""
        if straight := [name for name, turns in zip(body.names, body.turns, strict=True) if not turns]:
            raise ConfigError(f"joint {straight[0]} does not turn: only arms with revolute joints are modelled")
        return cls(body.placements, body.axes, body.parameters().reshape(-1, PER_LINK), body.gravity_field)

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.axes)

    def with_inertial(self, parameters: Float) -> Chain:
        """The same arm with other inertial parameters, (10 n,) as in ``Body.parameters``."""
        return replace(self, inertial=parameters.reshape(self.joints, PER_LINK))

    def carrying(self, body: Float) -> Chain:
        """The same arm without masses but a body at the last joint's frame: its m and m·c (3), in kg and kg m."""
        inertial = np.zeros_like(self.inertial)
        inertial[-1, : len(body)] = body
        return replace(self, inertial=inertial)

    def transforms(self) -> tuple[Float, Float, Float]:
        """The joints' transforms as A + sin q · B + cos q · C, each (n, 4, 4); Rodrigues' formula."""
        skew = np.zeros((self.joints, 4, 4))
        skew[:, :3, :3] = skew_of(self.axes)
        square, one = skew @ skew, np.eye(4)
        return self.placements @ (one + square), self.placements @ skew, -self.placements @ square


def skew_of(vectors: Float) -> Float:
    """Matrices (n, 3, 3) with K · x = v × x for vectors v (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
