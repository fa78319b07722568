"""Finds runs of motion between rests of the whole arm, from encoders that may jump or stand still."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot.stretches import stretches

WINDOW = 0.06
"""Time over which speed is computed, s."""
MOVING = math.radians(0.6)
"""Speed above which a joint moves, rad/s …"""
NOISE = 8.0
"""… or, if larger, in standard deviations of the noise of its speed."""
SHORTEST_REST = 0.06
SHORTEST_RUN = 0.12
"""Shortest rest and shortest run, s."""
SAME_POSE = math.radians(0.8)
"""Largest difference between equal rest poses, per joint, rad; a run in which no joint moves further is ignored."""
SETTLED = 0.1
"""Time over which the poses before and after a run are averaged (median), s."""
JUMP = math.radians(0.5)
"""A step between two samples larger than this, rad, and out of proportion to its neighbours, is not motion."""


@dataclass(frozen=True, slots=True)
class Run:
    """Samples ``first`` to ``last`` of one motion; ``before`` and ``after`` (n,) rad are the poses around it."""

    first: int
    last: int
    before: Float
    after: Float
    jumped: tuple[Float, Float]
    """Sums (n,) rad of the encoders' ``jumps`` in the rests before and after it, the moment of setting off included."""
    whole: bool = True
    """False if the recording, or a hole in it, begins or ends within the motion or so close that no rest is seen."""


def find_runs(recording: Recording) -> list[Run]:
    """Every run of motion, in order."""
    step = recording.step
    smooth = without_jumps(recording.position)
    jumped = recording.position - smooth
    unknown = np.zeros(len(smooth), bool) if recording.unknown is None else recording.unknown
    broken = np.flatnonzero(jumps(recording.position).any(axis=1) | unknown[1:] | unknown[:-1])
    half = max(1, round(WINDOW / 2 / step))
    speed, measured = np.zeros_like(smooth), np.zeros(len(smooth), bool)
    speed[half:-half] = (smooth[2 * half :] - smooth[: -2 * half]) / (2 * half * step)
    holes = np.concatenate([[0], np.cumsum(unknown)])
    measured[half:-half] = holes[2 * half + 1 :] == holes[: -2 * half - 1]
    limit: Float = np.maximum(MOVING, NOISE * white_noise(smooth, 4) * math.sqrt(2) / (2 * half * step))
    moving = np.any(np.abs(speed) > limit, axis=1) & measured
    spans = _spans(moving, max(1, round(SHORTEST_REST / step)))
    settled = max(1, round(SETTLED / step))
    out = []
    for k, (first, last) in enumerate(spans):
        low = spans[k - 1][1] if k else 0
        high = spans[k + 1][0] if k + 1 < len(spans) else len(smooth) - 1
        low = max(low, first - settled, *broken[broken <= first][-1:] + 1)
        high = min(high, last + settled, *broken[broken >= last][:1])
        before = np.median(recording.position[low : max(low, first) + 1], axis=0)
        after = np.median(recording.position[min(last, high) : high + 1], axis=0)
        way = np.ptp(smooth[first : last + 1], axis=0).max()
        if (last - first) * step >= SHORTEST_RUN and way > SAME_POSE:
            whole = bool(measured[first - 1] and measured[last + 1])
            out.append(Run(first, last, before, after, (jumped[min(first + half + 1, last)], jumped[last]), whole))
    begins, ends = [run.jumped[0] for run in out], [run.jumped[1] for run in out]
    rests = [b - a for a, b in zip([jumped[0], *ends], [*begins, jumped[-1]], strict=True)]
    return [replace(run, jumped=around) for run, around in zip(out, pairwise(rests), strict=True)]


def jumps(position: Float) -> Float:
    """Steps (N - 1, n) rad between samples that no motion causes, as when an encoder fails; else 0."""
    step = np.diff(position, axis=0)
    size = np.abs(step)
    around = np.zeros_like(size)
    around[1:] = size[:-1]
    around[:-1] = np.maximum(around[:-1], size[1:])
    return np.where((size > JUMP) & (size > 4 * around), step, 0.0)


def without_jumps(position: Float) -> Float:
    """Positions (N, n) without ``jumps``."""
    out = position.copy()
    out[1:] -= np.cumsum(jumps(position), axis=0)
    return out


def _spans(moving: NDArray[np.bool_], gap: int) -> list[tuple[int, int]]:
    """First and last sample of each motion; motions at most ``gap`` samples apart are joined."""
    joined: list[tuple[int, int]] = []
    for first, end in stretches(moving):
        if joined and first - joined[-1][1] <= gap:
            joined[-1] = (joined[-1][0], end - 1)
        else:
            joined.append((first, end - 1))
    return joined
