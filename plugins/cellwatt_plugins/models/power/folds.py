"""Folds of held-out moves: in turn, and the fastest and the slowest moves, as models must extrapolate to both."""

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
"""Number of moves below which each is a fold of its own."""
BLOCKS: Final = 8
"""Number of folds of a recording that is one long move."""
GAIN: Final = 0.995
"""Largest ratio of the held-out mean square error, with an effect to without, on average over the folds."""
HARM: Final = 1.02
"""Largest such ratio in any fold; an effect above it is passed over, however much it gains on average."""


def folds_of(moves: Moves) -> NDArray[np.int64]:
    """The fold (N,) of each row: the fastest moves, the slowest, and the others in turn.

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
    """Return the effects that lower the held-out error, the best first, and the remaining error in each fold.

    ``scores`` gives the mean square error (folds,) for each of several sets of effects, ``tried`` the effects worth a
    trial beside a set.
    """
    found: list[str] = []
    (now,) = scores([found])
    while True:
        more = [e for e in tried(found) if e not in found]
        errors = scores([[*found, e] for e in more])
        trials = {e: error / now for e, error in zip(more, errors, strict=True)}
        harmless = [e for e in trials if trials[e].max() <= HARM]
        best = min(harmless, key=lambda e: float(trials[e].mean()), default=None)
        if best is None or trials[best].mean() > GAIN:
            return found, now
        found.append(best)
        now = now * trials[best]
