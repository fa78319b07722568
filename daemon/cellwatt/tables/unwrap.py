"""Angles that a device counts modulo a turn, continued across the turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

TURN = 2 * np.pi
SLACK = 0.05
"""rad by which angles modulo a turn may leave that turn."""
SMALL = np.pi / 4
"""rad: nine in ten steps of a motion that can be followed are no larger."""
ALIKE = 5.0
"""Times the largest usual step, or ``SLACK``, that is left of a step once a whole turn is taken off."""


def wraps(angles: Float) -> NDArray[np.intp]:
    """Rows of ``angles`` (N,) rad, NaN where unknown, in which they have jumped by a turn since the row before.

    Only of a motion: angles that stay within one turn, whose other steps are small, and whose jumps are turns.
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
    left = np.abs(np.abs(steps[jumps]) - TURN)
    if usual[0] > SMALL or np.any(left > max(ALIKE * usual[1], SLACK)):
        return np.empty(0, np.intp)
    return np.asarray(rows[1:][jumps], np.intp)


def unwrapped(angles: Float) -> Float:
    """The ``angles`` (N,) rad, continued by whole turns where they jump by one; the middle one is within ±π."""
    at = wraps(angles)
    if not len(at):
        return angles
    before = np.array([angles[:row][np.isfinite(angles[:row])][-1] for row in at])
    turns = np.zeros(len(angles))
    turns[at] = -np.sign(angles[at] - before)
    out = angles + TURN * np.cumsum(turns)
    return np.asarray(out - TURN * np.round(np.nanmedian(out) / TURN))
