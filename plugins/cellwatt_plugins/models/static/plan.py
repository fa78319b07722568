"""Plan of the poses to hold: spread evenly over the joints' ranges, free of collisions, with short moves between."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.progress import stage, steps
from cellwatt_plugins.robot.collision import Checker

STAGE: Final = 40
"""Number of poses that may be enough for a model."""
_TRIED: Final = 20  # positions of the sequence per wanted pose
_PASSES: Final = 60


@dataclass(frozen=True)
class Plan:
    """Poses in the order in which they are held."""

    q: Float
    """(N, n) rad."""
    unsafe: int
    """Number of positions of the sequence left out because the arm would touch itself or the floor."""
    unreachable: int
    """Number of poses left out because the straight path to them is not safe."""
    travel: float
    """Total time of all moves at full speed, s."""


def plan_poses(count: int, limits: Float, speed: Float, checker: Checker) -> Plan:
    """``count`` poses within ``limits`` (n, 2) rad, for joints of ``speed`` (n,) rad/s.

    Raises ``ConfigError`` if too few positions within the limits are safe, or no path between two of them is.
    """
    with stage("choosing poses"):
        q, unsafe = safe_places(count, limits, checker)
    with stage("choosing their order"):
        ordered = q[staged_order(q, speed)]
    found = np.stack(_joined(ordered, checker))
    return Plan(found, unsafe, len(ordered) - len(found), travel(found, speed))


def _joined(poses: Float, checker: Checker) -> list[Float]:
    """The longest sequence of ``poses`` (N, n), in their order, whose straight paths from one to the next are safe.

    A pose without a safe path from the one before is left out. If most are, the sequence began in a place from which
    they cannot be reached: another begins with the first pose left out.
    """
    longest: list[Float] = []
    left = list(poses)
    while len(left) > len(longest):
        found, out = left[:1], list[Float]()
        for pose in steps(left[1:], "checking the way to pose"):
            (found if checker.safe_move(found[-1], pose) else out).append(pose)
        longest, left = max(longest, found, key=len), out
    if len(longest) < 2:
        raise ConfigError(
            f"no straight path between two of {len(poses)} safe poses is safe: narrow lower_limit and upper_limit in "
            "robot.yaml, or correct its capsules"
        )
    return longest


def safe_places(count: int, limits: Float, checker: Checker) -> tuple[Float, int]:
    """The first ``count`` safe positions (count, n) rad of the Halton sequence, and the number of unsafe ones
    skipped."""
    tried = within(limits, halton(_TRIED * count, len(limits)))
    kept: list[Float] = []
    seen = have = 0
    while have < count and seen < len(tried):
        block = tried[seen : seen + count - have]
        kept.append(block[checker.safe(block)])
        seen += len(block)
        have += len(kept[-1])
    if have < count:
        raise ConfigError(
            f"only {have} of {seen} positions within the joints' limits are safe: narrow lower_limit and upper_limit "
            "in robot.yaml, or correct its capsules"
        )
    return np.concatenate(kept), seen - count


def halton(count: int, dimensions: int) -> Float:
    """Positions 1 to ``count`` of the Halton sequence, (count, dimensions) in 0 … 1; Numerische Mathematik 2, 1960."""
    from scipy.stats import qmc  # takes a second to load, and only plans need it

    return np.asarray(qmc.Halton(dimensions, scramble=False).random(count + 1)[1:])


def within(limits: Float, share: Float) -> Float:
    """Angles at a ``share`` (N, n), 0 … 1, of each joint's range."""
    return np.asarray(limits[:, 0] + share * (limits[:, 1] - limits[:, 0]))


def travel(q: Float, speed: Float) -> float:
    """Time in s through poses in their order; all joints move at once, the slowest determines the time of a move."""
    return float(np.sum(np.max(np.abs(np.diff(q, axis=0)) / speed, axis=1)))


def staged_order(q: Float, speed: Float) -> NDArray[np.intp]:
    """Short paths within the first ``STAGE`` poses, then within the next as many, then twice as many, and so on.

    A collection that is stopped early then has poses from the whole range.
    """
    edges = [0, STAGE]
    while edges[-1] < len(q):
        edges.append(2 * edges[-1])
    order = np.zeros(0, dtype=np.intp)
    for first, last in pairwise(edges):
        stage = np.arange(first, min(last, len(q)))
        if len(order):  # begin with the pose nearest to the end of the last stage
            away = np.max(np.abs(q[stage] - q[order[-1]]) / speed, axis=1)
            stage = stage[np.argsort(away, kind="stable")]
        order = np.concatenate([order, stage[short_order(q[stage], speed)]])
    return order


def short_order(q: Float, speed: Float) -> NDArray[np.intp]:
    """An order with short moves from the first pose: to the nearest next one, then 2-opt (Croes, 1958)."""
    scaled = q / speed
    apart = np.max(np.abs(scaled[:, None] - scaled), axis=2)
    order = _nearest(apart)
    for _ in range(_PASSES):
        if not _untangled(order, apart):
            break
    return order


def _nearest(apart: Float) -> NDArray[np.intp]:
    unvisited = np.ones(len(apart), dtype=np.bool_)
    order = np.zeros(len(apart), dtype=np.intp)
    unvisited[0] = False
    for place in range(1, len(apart)):
        order[place] = np.argmin(np.where(unvisited, apart[order[place - 1]], np.inf))
        unvisited[order[place]] = False
    return order


def _untangled(order: NDArray[np.intp], apart: Float) -> bool:
    """Reverse sections of the ``order`` in place where that shortens the path; return whether any was reversed."""
    better = False
    for i in range(len(order) - 2):
        a, b = order[i], order[i + 1]
        ends, after = order[i + 2 :], order[i + 3 :]
        onward = np.append(apart[b, after] - apart[ends[:-1], after], 0.0)  # nothing comes after the last
        change = apart[a, ends] - apart[a, b] + onward
        best = int(np.argmin(change))
        if change[best] < -1e-9:
            order[i + 1 : i + 3 + best] = order[i + 1 : i + 3 + best][::-1].copy()
            better = True
    return better
