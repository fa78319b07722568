"""Two-level schedules: when a load was on, found from a noisy signal of its size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.stretches import stretches

BLOCK = 0.04
"""Time in s over which a signal is averaged before the search."""


def levels(
    courses: Sequence[Float], weights: Sequence[Float], steps: Sequence[float], shortest: float
) -> list[tuple[int, int, int]]:
    """Stretches (run, first, last sample) where the signals ``courses`` (N,) are at the higher of two levels.

    The two levels and the switching times are found together: Viterbi's path between the levels with a cost for each
    switch, levels updated until they no longer change (two-state segmental k-means). Stretches under ``shortest`` s are
    ignored unless the recording cuts them; [] if there are no two levels.
    """
    blocks = [_blocks(c, w, max(1, round(BLOCK / s))) for c, w, s in zip(courses, weights, steps, strict=True)]
    values = np.concatenate([v for v, _ in blocks])
    weight = np.concatenate([w for _, w in blocks])
    usual = float(np.median(weight))
    # A few samples of great weight must not decide alone.
    blocks = [(v, np.minimum(w, 2 * usual)) for v, w in blocks]
    weight = np.minimum(weight, 2 * usual)
    usable = weight > 0.2 * usual
    if np.count_nonzero(usable) < 10:
        return []
    low, high = np.quantile(values[usable], [0.1, 0.9])
    paths: list[NDArray[np.bool_]] = []
    for _ in range(12):
        spread = _spread(values, weight, low, high)
        paths = _paths(blocks, low, high, spread)
        path = np.concatenate(paths)
        if path.all() or not path.any():
            return []
        new = np.average(values[~path], weights=weight[~path]), np.average(values[path], weights=weight[path])
        if np.allclose(new, (low, high), rtol=1e-3, atol=1e-9):
            break
        low, high = float(new[0]), float(new[1])
    out = []
    for i, (path, course, step) in enumerate(zip(paths, courses, steps, strict=True)):
        width = max(1, round(BLOCK / step))
        for first, last in stretches(path):
            cut = first == 0 or last == len(path)
            if cut or (last - first) * width * step >= shortest:
                start = _edge(course, first * width, 2 * width, (low, high))
                end = _edge(course, min(last * width, len(course)), 2 * width, (high, low))
                out.append((i, start, end - 1))
    return out


def _edge(course: Float, about: int, width: int, sides: tuple[float, float]) -> int:
    """First sample after a step ``about`` this sample, where the signal fits its levels on both ``sides`` best."""
    if about <= 0 or about >= len(course):
        return about
    begin, end = max(0, about - width), min(len(course), about + width)
    part = course[begin:end]
    left = np.concatenate([[0.0], np.cumsum(np.square(part - sides[0]))])
    right = np.concatenate([np.cumsum(np.square(part - sides[1])[::-1])[::-1], [0.0]])
    return begin + int(np.argmin(left + right))


def switching_charge(runs: Sequence[States], switches: int) -> float:
    """nats for choosing this number of switching times from the whole recorded time."""
    total = sum(float(run.time[-1] - run.time[0]) for run in runs)
    return switches * float(np.log(max(total / BLOCK, 1.0)))


def _blocks(course: Float, weight: Float, width: int) -> tuple[Float, Float]:
    edges = np.arange(0, len(course), width)
    total = np.add.reduceat(weight, edges)
    return np.add.reduceat(course * weight, edges) / np.maximum(total, 1e-300), total


def _spread(values: Float, weight: Float, low: float, high: float) -> float:
    """Weighted mean square distance to the nearer level: the variance of a value of weight 1."""
    off = np.minimum(np.square(values - low), np.square(values - high)) * weight
    return float(np.mean(off)) + 1e-12


def _paths(blocks: Sequence[tuple[Float, Float]], low: float, high: float, spread: float) -> list[NDArray[np.bool_]]:
    """Most likely path (True: high) through the values and weights of each run, with a cost of switching of 12 nats.

    All runs are searched side by side: a step of many takes as long as a step of one.
    """
    lengths = np.array([len(values) for values, _ in blocks])
    cost = np.zeros((int(lengths.max()), len(blocks), 2))
    for r, (values, weight) in enumerate(blocks):
        own = np.column_stack([weight * np.square(values - low), weight * np.square(values - high)]) / (2 * spread)
        cost[: len(values), r] = np.minimum(own, 8.0)
    best = cost[0].copy()
    came, state = np.zeros(cost.shape, np.bool_), np.argmin(best, axis=1)
    ends = set((lengths - 1).tolist())
    for i in range(1, len(cost)):
        switch = best[:, ::-1] + 12.0
        np.less(switch, best, out=came[i])
        best = np.minimum(best, switch) + cost[i]
        if i in ends:
            state = np.where(i < lengths, np.argmin(best, axis=1), state)
    came &= (np.arange(len(cost))[:, None] < lengths)[:, :, None]
    path, every = np.zeros(cost.shape[:2], np.bool_), np.arange(len(blocks))
    for i in range(len(cost) - 1, -1, -1):
        path[i] = state
        state = state ^ came[i, every, state]
    return [path[:length, r] for r, length in enumerate(lengths)]
