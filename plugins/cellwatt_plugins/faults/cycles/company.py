"""Probability that a cycle with joints off their path is a known one: by the joints that keep to theirs, and by
whether what is off may be an encoder at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.faults.cycles.pattern import WAY, Pattern
from cellwatt_plugins.faults.cycles.runs import Run

COINCIDENCE = 4.0
"""Natural logarithm of the odds against another task for each move of a joint that ends where it should: within half a
degree or so of any place in a range of a radian."""
FOREIGN_ODDS = 12.0
"""The same at most, and where more moves than one beside one for each joint off its path are those of the pattern."""
BEYOND = 2.0
"""An encoder is right again only where a wrong scale would be off by so many times the limit."""


def known_odds(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern, odd: Sequence[int]) -> float:
    """Natural logarithm of the odds against another task that begins like ``pattern``.

    ``seen`` are its moves with the first and last run of each, ``odd`` the joints (0-based) off their path. Each of
    them but the first takes back what one that keeps to its path has given: there are more to choose from.
    """
    if any(_right_again(seen, pattern, joint) for joint in odd):
        return 0.0
    if len(seen) > 1 + len(odd):
        return FOREIGN_ODDS
    off, company = False, 1 - len(odd)
    for move, first, last in seen:
        missed = np.maximum(np.abs(first.before - pattern.poses[0][move]), np.abs(last.after - pattern.poses[1][move]))
        off = off or bool(np.any((missed > pattern.limits)[list(odd)]))
        company += off * int(np.sum(np.delete(pattern.ways[move], odd) > WAY))
    return min(FOREIGN_ODDS, COINCIDENCE * max(0, company))


def _right_again(seen: Sequence[tuple[int, Run, Run]], pattern: Pattern, joint: int) -> bool:
    """True if a joint goes back to its path after a rest off it, as no encoder does that is shifted, stuck or of a
    wrong scale; that one shows no error near the cycle's start."""
    shown = np.array([seen[0][1].before[joint], *(last.after[joint] for _, _, last in seen)])
    healthy = pattern.poses[1][[move for move, _, _ in seen], joint]
    healthy = np.concatenate([[pattern.poses[0][seen[0][0], joint]], healthy])
    away = np.abs(healthy - pattern.poses[0][0, joint])
    error, limit = np.abs(shown - healthy), float(pattern.limits[joint])
    for before in np.flatnonzero(error > limit):
        scaled = error[before] * away[before + 1 :] / max(float(away[before]), WAY)
        went = np.abs(shown[before + 1 :] - shown[before]) > WAY
        if np.any((error[before + 1 :] < limit) & (scaled > BEYOND * limit) & went):
            return True
    return False
