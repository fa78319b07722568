"""Coordinate search for the shape with the greatest evidence near a start."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.robot.effects.effect import Shape

CLOSE, NEAR = 1.01, 0.02
"""Ratio to a bound, and share of the range, within which a shape counts as at its bound."""
DECADES = 30.0
"""Ratio of its bounds above which a shape parameter is searched by its logarithm."""


def climb(evidence: Callable[[Shape], float], start: Shape, bounds: Sequence[tuple[float, float]]) -> Shape:
    """Shape of greatest evidence near ``start``, found one parameter at a time with steps that halve."""
    best, top = start, evidence(start)
    for share in (0.2, 0.05):
        for i, (low, high) in enumerate(bounds):
            if high <= low:
                continue
            log = _wide(low, high)
            size = 2.5 if log else min(max(abs(best[i]), 0.05 * (high - low)), high - low)
            step = share * size
            for _ in range(5):
                moved = False
                for way in (1, -1):
                    value = best[i] * float(np.exp(way * step)) if log else best[i] + way * step
                    value = float(np.clip(value, low, high))
                    trial = (*best[:i], value, *best[i + 1 :])
                    gain = evidence(trial)
                    if gain > top:
                        best, top, moved = trial, gain, True
                        break
                if not moved:
                    step /= 2
    return best


def at_bound(term: Term) -> bool:
    """True if a refined shape reached one of its bounds."""
    pairs = zip(term.shape, term.effect.bounds(term.shape), strict=False)
    return any(high > low and _near_end(value, low, high) for value, (low, high) in pairs)


def _near_end(value: float, low: float, high: float) -> bool:
    if _wide(low, high):
        return min(value / low, high / value) < CLOSE
    return min(value - low, high - value) < NEAR * (high - low)


def _wide(low: float, high: float) -> bool:
    """True if a shape parameter spans decades and is searched by its logarithm."""
    return low > 0 and high > DECADES * low
