"""Stretches of a course in which something holds, and rests at one pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and one past the last index of each stretch of true ``flags`` (N,)."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def at_one_pose(poses: NDArray[np.float64], within: float, weights: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of ``poses`` (N, n) rad are ``within`` rad, in each joint, of the one whose likes weigh most."""
    alike = np.all(np.abs(poses[:, None] - poses[None]) < within, axis=2)
    return np.asarray(alike[np.argmax(alike @ weights)])
