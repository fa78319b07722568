"""Finds repetitions of programs in a stretch: from rest to rest at the pose where the arm rests most often."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.fleet.reading import Stretch
from cellwatt_plugins.robot.stretches import at_one_pose, stretches

STILL: Final = 0.02
"""Speed below which a joint is at rest, rad/s."""
REST: Final = 0.25
"""Shortest rest, s."""
SAME_POSE: Final = 0.02
"""Largest difference of a joint between two rests at one pose, rad."""
LONGEST: Final = 300.0
"""Longest repetition, s; longer motion is cut into pieces."""
PIECE: Final = 20.0
"""Length of a piece if no repetition is found, s."""
SAME_TIME, SAME_WAY, SLACK = 0.03, 0.02, 0.02
"""Largest differences between repetitions of one program: duration (share), path (share of the total, and rad)."""


@dataclass(frozen=True)
class Span:
    """Samples ``first`` to before ``last`` of a stretch."""

    first: int
    last: int
    whole: bool
    """True for a repetition, false for a piece."""


def spans_of(stretch: Stretch) -> list[Span]:
    """Return the repetitions of a stretch, or pieces of it if the arm does not return to a rest pose."""
    rests = _rests_at_home(stretch)
    found = [Span((a + b) // 2, (c + d) // 2, True) for (a, b), (c, d) in pairwise(rests)]
    found = [span for span in found if (span.last - span.first) * stretch.step <= LONGEST]
    if found:
        return found
    count = max(1, round(len(stretch.time) * stretch.step / PIECE))
    edges = np.linspace(0, len(stretch.time), count + 1).round().astype(int).tolist()
    return [Span(a, b, False) for a, b in pairwise(edges)]


def at_work(stretch: Stretch, span: Span) -> tuple[int, int]:
    """Return the first moving sample and one past the last, without the rests before and after."""
    moves = np.flatnonzero(~_still(stretch)[span.first : span.last])
    return (span.first + int(moves[0]), span.first + int(moves[-1]) + 1) if len(moves) else (span.first, span.first)


def signature(stretch: Stretch, span: Span) -> tuple[float, ...]:
    """Return the features that distinguish programs: duration, s, and path (n,) rad of each joint."""
    first, last = at_work(stretch, span)
    way = np.abs(np.diff(stretch.position[first:last] / stretch.levers, axis=0)).sum(axis=0)
    return ((last - first) * stretch.step, *way.tolist())


def programs(signatures: list[tuple[float, ...]]) -> NDArray[np.intp]:
    """Number the programs (K,) of repetitions from 0 by their signatures; similar ones have the same number."""
    known: list[Float] = []
    out = np.zeros(len(signatures), np.intp)
    for i, each in enumerate(signatures):
        own = np.array(each)
        way = own[1:].sum()
        for number, other in enumerate(known):
            near = abs(own[0] - other[0]) <= SAME_TIME * other[0] + 0.05
            if near and np.all(np.abs(own[1:] - other[1:]) <= SAME_WAY * way + SLACK):
                out[i] = number
                break
        else:
            out[i] = len(known)
            known.append(own)
    return out


def _rests_at_home(stretch: Stretch) -> list[tuple[int, int]]:
    """Rests at the most frequent rest pose, the first among equals."""
    rests = [(a, b) for a, b in stretches(_still(stretch)) if (b - a) * stretch.step >= REST]
    return at_one_pose(stretch.position / stretch.levers, rests, SAME_POSE, [1.0] * len(rests))


def _still(stretch: Stretch) -> NDArray[np.bool_]:
    """(N,) true while no joint moves."""
    return np.asarray(np.all(np.abs(stretch.velocity) <= STILL * stretch.levers, axis=1))
