"""Moves held out together: by turns, and the fastest and the slowest, as models must carry beyond both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.moves import Moves

TURNS: Final = 4
EXTREME: Final = 0.15
"""Share of the moves that count as fastest, and as slowest."""
FEW: Final = 12
"""Moves below which each is a fold of its own."""
BLOCKS: Final = 8
"""Folds of a recording that is one long move."""
GAIN: Final = 0.995
"""An effect must bring the held-out error down to this share of its square."""
HARM: Final = 1.02
"""And raise it nowhere above this."""


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


def grown(
    scores: Callable[[Sequence[Sequence[str]]], Sequence[Float]], tried: Callable[[Sequence[str]], Sequence[str]]
) -> tuple[list[str], Float]:
    """Return the effects that lower the held-out error, the best first, and what they leave of it in each fold.

    ``scores`` gives the mean square (folds,) with each of some sets of effects, ``tried`` the effects worth a trial
    beside a set.
    """
    found: list[str] = []
    (now,) = scores([found])
    while True:
        more = [e for e in tried(found) if e not in found]
        left = scores([[*found, e] for e in more])
        trials = {e: error / now for e, error in zip(more, left, strict=True)}
        best = min(trials, key=lambda e: float(trials[e].mean()), default=None)
        if best is None or trials[best].mean() > GAIN or trials[best].max() > HARM:
            return found, now
        found.append(best)
        now = now * trials[best]
