"""Arm motions with known starts and ends: the truth of these tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

START = 1_700_000_000_000_000_000  # ns
HOME = (0.1, -1.0, 0.7, 0.0)


@dataclass(frozen=True)
class Leg:
    """Joints (1-based) that cover ``by`` rad each in ``seconds`` from ``at`` s on, smoothly or with a constant
    acceleration."""

    at: float
    by: dict[int, float]
    seconds: float
    smooth: bool = True


def way(t: np.ndarray, leg: Leg) -> np.ndarray:
    """Share of the way covered at times t, s."""
    s = np.clip((t - leg.at) / leg.seconds, 0, 1)
    if leg.smooth:
        return 10 * s**3 - 15 * s**4 + 6 * s**5
    return np.where(s < 0.5, 2 * s**2, 1 - 2 * (1 - s) ** 2)


def positions(legs: Sequence[Leg], seconds: float, *, rate: float = 50.0, noise: float = 3e-5, seed: int = 0):
    """Times (n,) ns and measured positions (n, joints) rad of ``legs`` within ``seconds``."""
    t = np.arange(round(seconds * rate)) / rate
    q = np.tile(np.asarray(HOME), (len(t), 1))
    for leg in legs:
        for joint, by in leg.by.items():
            q[:, joint - 1] += by * way(t, leg)
    q += noise * np.random.default_rng(seed).standard_normal(q.shape)
    return START + np.round(t * 1e9).astype(np.int64), q


def since_start(time: int) -> float:
    """ns as s from the start of the motion."""
    return (time - START) * 1e-9


def follow(moves: Sequence[dict[int, float]], *, seconds: float = 0.8, rest: float = 0.4, at: float = 1.0) -> list[Leg]:
    """Legs one after the other with rests between."""
    legs = []
    for by in moves:
        legs.append(Leg(at, by, seconds))
        at += seconds + rest
    return legs
