"""Recognises the poses that an arm holds in a recording, from its encoders alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Float, Nanoseconds

STILL: Final = 5e-4
"""rad: an arm is at rest while all joints stay within this distance of where they stopped."""
SETTLE: Final = 0.5e9
"""ns at rest before torque samples are used."""
HOLD: Final = 2e9 - 1e6
"""ns over which the torque is averaged, less rounding."""
HOLE: Final = 0.25e9
"""ns without a sample after which the pose is no longer held."""


def held(time: Nanoseconds, q: Float) -> list[slice]:
    """The samples used of each held pose, once each and in order, from times (N,) ns and angles ``q`` (N, n) rad."""
    found: list[slice] = []
    anchor, since, begun, reported = np.full(q.shape[1], np.inf), 0, 0, False
    for i, gap in enumerate(np.diff(time, prepend=time[:1])):
        moved = bool(np.max(np.abs(q[i] - anchor)) > STILL)
        if moved or not 0 <= gap <= HOLE:
            anchor, since, begun, reported = q[i] if moved else anchor, time[i], 0, reported and not moved
        elif not reported and time[i] - since >= SETTLE:
            begun = begun or i
            if reported := time[i] - time[begun] >= HOLD:
                found.append(slice(begun, i + 1))
    return found


def turned(q: Float) -> Float:
    """Angle (N, n) rad at which each joint last reversed; NaN until it has moved.

    A movement within ``STILL`` is no reversal.
    """
    out = np.full_like(q, np.nan)
    if not len(q):
        return out
    last, furthest, sign = out[0], q[0], np.zeros(q.shape[1])
    for i, row in enumerate(q):
        way = row - furthest
        turn = (np.abs(way) > STILL) & (way * sign <= 0)
        last, sign = np.where(turn, furthest, last), np.where(turn, np.sign(way), sign)
        out[i] = last
        furthest = np.where(way * sign > 0, row, furthest)
    return out
