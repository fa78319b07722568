"""Names the joint that explains the ternary codes of a task's intervals.

The network of Sabry et al. (section V.D) is trained on a table of the intervals in which each joint is active; its
largest output names the joint. This module makes the same comparison directly, by the share of intervals in which
the codes and a joint's column agree, among the intervals in which either is nonzero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.criteria import Codes

SHAPE_WEIGHT = 0.2
"""Weight of the likeness of residual and motion; the agreement has weight 1, both are at most 1."""
TIE = 0.05
"""Joints whose score is lower than the best by at most this are alternatives."""


@dataclass(frozen=True, slots=True)
class Suspect:
    """A joint (1-based) that explains deviating intervals, its score, and the joints that explain them equally well."""

    joint: int
    score: float
    alternatives: tuple[int, ...]


def agreement(codes: Codes, expected: Codes, *, signed: bool = False) -> Float:
    """Agreement (joints,) 0 … 1 of the codes (k,) of k intervals with each joint's column of ``expected`` (k, joints).

    ``expected`` is nonzero where a fault of the joint changes the power: 1 where the joint moves, or if ``signed``
    the code from a fault table.
    """
    hit = (codes[:, None] != 0) & (expected != 0)
    if signed:
        hit &= codes[:, None] == expected
    either = (codes[:, None] != 0) | (expected != 0)
    return np.asarray(hit.sum(axis=0) / np.maximum(either.sum(axis=0), 1), dtype=np.float64)


def likeness(residual: Float, speed: Float, way: Float) -> float:
    """0 … 1: correlation of a power residual (n,) with a joint's speed or position (n,) in one interval."""
    if len(residual) < 4 or np.ptp(residual) == 0:
        return 0.0
    motions = [motion for motion in (np.abs(speed), way) if np.ptp(motion) > 0]
    return max((abs(float(np.corrcoef(residual, motion)[0, 1])) for motion in motions), default=0.0)


def suspects(codes: Codes, moving: Codes, shape: Float) -> Sequence[Suspect]:
    """A small set of joints that explains all nonzero codes, best first.

    ``codes`` (k,), ``moving`` (k, joints) 1 where a joint moves, ``shape`` (joints,) 0 … 1. Intervals without a
    moving joint are ignored.
    """
    found: list[Suspect] = []
    while (codes[:, None] * moving).any():
        hits = (codes[:, None] * moving != 0).any(axis=0)
        scores = np.where(hits, agreement(codes, moving) + SHAPE_WEIGHT * shape, -1.0)
        best = int(np.argmax(scores))
        mine = (codes != 0) & (moving[:, best] != 0)
        others = [
            j + 1
            for j in np.flatnonzero(scores >= scores[best] - TIE).tolist()
            if j != best and np.array_equal((codes != 0) & (moving[:, j] != 0), mine)
        ]
        found.append(Suspect(best + 1, float(scores[best]), tuple(others)))
        codes, moving = codes[~mine], moving[~mine]
    return found
