"""Stretches of a series with true flags, and rests at one pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and one past the last index of each stretch of true ``flags`` (N,)."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def at_one_pose(
    position: NDArray[np.float64], rests: Sequence[tuple[int, int]], within: float, weights: Sequence[float]
) -> list[tuple[int, int]]:
    """Return the rests of ``position`` (N, n) rad that are ``within`` rad, in each joint, of the pose at which rests
    have the greatest total of ``weights``; the first of equals."""
    if not rests:
        return []
    poses = np.array([np.median(position[a:b], axis=0) for a, b in rests])
    each, weight = (np.all(np.abs(poses - pose) < within, axis=1) for pose in poses), np.asarray(weights)
    best = max(each, key=lambda alike: float(weight[alike].sum()))
    return [rest for rest, same in zip(rests, best, strict=True) if same]
