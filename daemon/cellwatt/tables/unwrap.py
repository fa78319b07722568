"""Unwraps angles that a device reports modulo a turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

TURN = 2 * np.pi
SLACK = 0.05
"""rad by which the range of angles modulo a turn may exceed a turn."""
SMALL = np.pi / 4
"""Largest 90th percentile of the steps of a motion that can be unwrapped, rad."""
ALIKE = 5.0
"""Largest remainder of a jump minus a turn, in multiples of the 99th percentile of the steps; at least ``SLACK``."""


def wraps(angles: Float) -> NDArray[np.intp]:
    """Rows of ``angles`` (N,) rad, NaN where unknown, at which they jump by a turn.

    Empty unless the angles stay within one turn, their other steps are small, and all their jumps are turns.
    """
    rows = np.flatnonzero(np.isfinite(angles))
    known = angles[rows]
    if len(known) < 2 or np.ptp(known) > TURN + SLACK:
        return np.empty(0, np.intp)
    steps = np.diff(known)
    jumps = np.abs(steps) > np.pi
    if not jumps.any() or jumps.all():
        return np.empty(0, np.intp)
    usual = np.quantile(np.abs(steps[~jumps]), [0.9, 0.99])
    remainder = np.abs(np.abs(steps[jumps]) - TURN)
    if usual[0] > SMALL or np.any(remainder > max(ALIKE * usual[1], SLACK)):
        return np.empty(0, np.intp)
    return np.asarray(rows[1:][jumps], np.intp)


def unwrapped(angles: Float) -> Float:
    """The ``angles`` (N,) rad, continued across jumps by a turn; their median is within ±π."""
    at = wraps(angles)
    if not len(at):
        return angles
    rows = np.flatnonzero(np.isfinite(angles))
    before = angles[rows[np.searchsorted(rows, at) - 1]]
    turns = np.zeros(len(angles))
    turns[at] = -np.sign(angles[at] - before)
    out = angles + TURN * np.cumsum(turns)
    return np.asarray(out - TURN * np.round(np.nanmedian(out) / TURN))
