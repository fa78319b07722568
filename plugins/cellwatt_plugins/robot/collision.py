"""Clearance of an arm from itself and from the floor, by coal; its links are rods with round ends."""

from __future__ import annotations

from typing import Final

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.arm import Arm
from cellwatt_plugins.robot.body import Solid
from cellwatt_plugins.robot.description import Capsule

CLEARANCE: Final = 0.02
"""Smallest allowed gap in m between two links, and between a link and the floor."""
_RADIUS: Final = 0.08  # m, of links whose outline the description lacks


class Checker:
    """Checks poses of one ``arm`` by the ``capsules`` and ``floor`` of its description.

    Pairs of neighbouring links are not checked, nor pairs closer than ``CLEARANCE`` in the middle of all ranges
    (``limits`` (n, 2) rad).
    """

    def __init__(self, arm: Arm, limits: Float) -> None:
        every = arm.description.capsules or rods(arm)
        field, height = arm.body.gravity_field, arm.description.floor
        # Without a stated floor, what the arm is mounted on: the wall, or the ceiling.
        up = np.array([0.0, 0.0, 1.0]) if height is None or not field.any() else -field / np.linalg.norm(field)
        floor = coal.Halfspace(up, height or 0.0)
        solids = [*map(solid, every), Solid(0, np.eye(4), floor)]
        apart = [(i, j) for i in range(len(every)) for j in range(i) if abs(every[i].link - every[j].link) > 1]
        middle = arm.body.distances(solids, apart)(limits.mean(axis=1)[None])[0]
        pairs = [pair for pair, gap in zip(apart, middle, strict=True) if gap > CLEARANCE]
        # The base and link 1 stand on the floor: they are not checked against it.
        above = [(i, len(every)) for i, capsule in enumerate(every) if capsule.link > 1]
        self.gaps = arm.body.distances(solids, [*pairs, *above])
        """Function of poses (N, n) rad: the clearance (N, k) m of each pair, then of each rod above the floor."""

    def safe(self, q: Float) -> NDArray[np.bool_]:
        """(N,) true if all gaps are ``CLEARANCE`` or more in poses ``q`` (N, n) rad."""
        return np.asarray((self.gaps(q) >= CLEARANCE).all(axis=1))

    def safe_move(self, start: Float, end: Float, step: float = 0.08) -> bool:
        """True if the straight path between two poses (n,), all joints together, is safe; checked every ``step``
        rad."""
        count = max(2, int(np.ceil(np.max(np.abs(end - start)) / step)))
        return bool(self.safe(start + np.linspace(0, 1, count + 1)[:, None] * (end - start)).all())


def solid(capsule: Capsule) -> Solid:
    """The capsule as coal's shape: along z, centred at its middle."""
    start, end = np.array(capsule.start), np.array(capsule.end)
    length = float(np.linalg.norm(end - start))
    placement = np.eye(4)
    placement[:3, 3] = 0.5 * (start + end)
    if length > 0:
        placement[:3, :3] = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start).matrix()
    return Solid(capsule.link, placement, coal.Capsule(capsule.radius, length))


def rods(arm: Arm) -> tuple[Capsule, ...]:
    """A rod of 8 cm radius from each joint to the next, for an arm without capsules in its description."""
    tips = arm.body.placements[:, :3, 3].tolist()
    return tuple(Capsule(link=i, start=(0.0, 0.0, 0.0), end=tip, radius=_RADIUS) for i, tip in enumerate(tips))
