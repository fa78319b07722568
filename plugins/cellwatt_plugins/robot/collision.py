"""Clearance of an arm from itself and from the floor; its links are rods with round ends."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.arm import Arm
from cellwatt_plugins.robot.description import Capsule

Float = NDArray[np.float64]

CLEARANCE: Final = 0.02
"""m that must be left between two links, and above the floor."""
_RADIUS: Final = 0.08  # m, of links without a description


class Checker:
    """Checks poses of one ``arm`` by the ``capsules`` and ``floor`` of its description.

    Rods of neighbouring links are left out, and pairs that are closer than ``CLEARANCE`` in the middle of all ranges
    (``limits`` (n, 2) rad).
    """

    def __init__(self, arm: Arm, limits: Float) -> None:
        every = arm.description.capsules or rods(arm)
        self._body, self._floor = arm.body, arm.description.floor
        self._links = np.array([capsule.link for capsule in every], np.intp)
        self._points = np.array([(capsule.start, capsule.end) for capsule in every])
        self._radii = np.array([capsule.radius for capsule in every])
        # The base and what turns on it stand on the floor.
        self._above = np.flatnonzero(self._links > 1)
        apart = [(i, j) for i in range(len(every)) for j in range(i) if abs(every[i].link - every[j].link) > 1]
        pairs = np.array(apart, np.intp).reshape(-1, 2)
        self._pairs = pairs[self._between(self._ends(limits.mean(axis=1)[None]), pairs)[0] > CLEARANCE]

    def gaps(self, q: Float) -> Float:
        """Clearance (N, k) m of each pair, then of each rod above the floor, in poses ``q`` (N, n) rad."""
        ends = self._ends(q)
        lowest = ends[:, self._above].min(axis=2)[:, :, 2] - self._radii[self._above]
        return np.hstack([self._between(ends, self._pairs), lowest - self._floor])

    def safe(self, q: Float) -> NDArray[np.bool_]:
        """(N,) true where all gaps are ``CLEARANCE`` or more in poses ``q`` (N, n) rad."""
        return np.asarray((self.gaps(q) >= CLEARANCE).all(axis=1))

    def safe_move(self, start: Float, end: Float, step: float = 0.08) -> bool:
        """True if the straight way between two poses (n,), all joints together, is safe; checked every ``step`` rad."""
        count = max(2, int(np.ceil(np.max(np.abs(end - start)) / step)))
        return bool(self.safe(start + np.linspace(0, 1, count + 1)[:, None] * (end - start)).all())

    def _ends(self, q: Float) -> Float:
        """Both ends of each of K capsules in the base's frame: (N, K, 2, 3)."""
        frames = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), self._body.forward(q)], axis=1)
        own = frames[:, self._links]
        return np.asarray(self._points @ own[..., :3, :3].swapaxes(-1, -2) + own[..., None, :3, 3])

    def _between(self, ends: Float, pairs: NDArray[np.intp]) -> Float:
        """Gaps (N, P) of pairs (P, 2)."""
        one, other = pairs.T
        apart = distance(ends[:, one].reshape(-1, 2, 3), ends[:, other].reshape(-1, 2, 3))
        return np.asarray(apart.reshape(len(ends), len(pairs)) - self._radii[one] - self._radii[other])


def distance(a: Float, b: Float) -> Float:
    """Distance (N,) between segments ``a`` and ``b`` (N, 2, 3); Ericson, Real-Time Collision Detection, 5.1.9."""
    start, along, across = a[:, 0] - b[:, 0], a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]

    def dot(x: Float, y: Float) -> Float:
        return np.asarray(np.sum(x * y, axis=1))

    tiny = 1e-12
    aa, bb, ab = dot(along, along) + tiny, dot(across, across) + tiny, dot(along, across)
    c, f = dot(along, start), dot(across, start)
    parallel = aa * bb - ab**2
    s = np.clip(np.where(parallel > tiny, (ab * f - c * bb) / np.maximum(parallel, tiny), 0.0), 0.0, 1.0)
    t = np.clip((ab * s + f) / bb, 0.0, 1.0)
    s = np.clip((t * ab - c) / aa, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + s[:, None] * along - t[:, None] * across, axis=1))


def rods(arm: Arm) -> tuple[Capsule, ...]:
    """A rod of 8 cm radius from each joint to the next, for an arm without capsules in its description."""
    tips = arm.body.placements[:, :3, 3].tolist()
    return tuple(Capsule(link=i, start=(0.0, 0.0, 0.0), end=tip, radius=_RADIUS) for i, tip in enumerate(tips))
