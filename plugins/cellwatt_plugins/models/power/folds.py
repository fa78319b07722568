"""Moves held out together: by turns, and the fastest and the slowest, as models must carry beyond both."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.models.power.moves import Moves

TURNS: Final = 4
EXTREME: Final = 0.15
"""Share of the moves that count as fastest, and as slowest."""
FEW: Final = 12
"""Moves below which each is a fold of its own."""
BLOCKS: Final = 8
"""Folds of a recording that is one long move."""


def folds_of(moves: Moves) -> NDArray[np.int64]:
    """The fold (N,) of each row: the fastest moves, the slowest, and the others by turns.

    Below ``FEW`` moves each is a fold; a recording in one or two pieces is cut into ``BLOCKS``.
    """
    if moves.count < 3:
        return np.minimum(np.arange(len(moves)) * BLOCKS // len(moves), BLOCKS - 1).astype(np.int64)
    if moves.count < FEW:
        return moves.move.copy()
    speed = [np.sqrt(np.mean(moves.qd[a:b] ** 2)) for a, b in moves.bounds()]
    order = np.argsort(speed)
    extreme = max(1, round(EXTREME * moves.count))
    fold = np.arange(moves.count) % TURNS
    fold[order[:extreme]] = TURNS
    fold[order[-extreme:]] = TURNS + 1
    return np.asarray(fold[moves.move], np.int64)
