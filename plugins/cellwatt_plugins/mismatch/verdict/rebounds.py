"""Rebounds: play between motor and link that shows in a residual which no law follows.

A link that has crossed the gap hits the flank and rebounds, in a way that no model foretells blow by blow. When it does
so can be told: just after its load has turned over, and at no other time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.robot.motion import FAST

Float = NDArray[np.float64]

DIE_OUT = 0.15
"""s after the load has turned over within which rebounds die out."""
AGAIN = 5
"""Times that the load must turn over."""
BLOWS = 5.0
"""Mean square residual of these moments, in units of the noise, that blows leave at least."""
ELSEWHERE = 0.1
"""Of what these moments have beyond the noise, the most that all others may have."""
SELDOM = 0.3
"""Share of the time that these moments may be: beyond, they are no moments."""


def rebounds(solution: Solution, joint: int) -> float | None:
    """Share of the time after a joint's load turned over, if all that is left lies there; None where it does not.

    Friction that turns over with the velocity is none of it: its moments are among the others.
    """
    problem = solution.problem
    if min(1 / rows.step for rows in problem.rows) < FAST:
        return None
    squared = np.square(solution.residual[:, joint] * problem.design.root[:, joint])
    there, turns = [], 0
    for states, rows in zip(problem.states, problem.rows, strict=True):
        load = np.sign(rows.of(states.load)[:, joint])
        turned = np.flatnonzero(load[1:] != load[:-1]) + 1
        after = np.zeros(len(load), np.bool_)
        for row in turned.tolist():
            after[row : row + round(DIE_OUT / rows.step) + 1] = True
        there.append(after)
        turns += len(turned)
    after = np.concatenate(there)
    share = float(np.mean(after))
    if turns < AGAIN or not 0 < share < SELDOM:
        return None
    blows, others = float(np.mean(squared[after])), float(np.mean(squared[~after]))
    return share if blows > BLOWS and others - 1 < ELSEWHERE * (blows - 1) else None
