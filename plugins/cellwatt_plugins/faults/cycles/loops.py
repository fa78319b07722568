"""Finds the tasks in a healthy recording: closed loops of moves that recur, whatever motion lies between them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.runs import SAME_POSE, Run

LONGEST = 80
"""Most moves in a task."""
FEWEST = 3
"""Fewest cycles of a task."""

Token = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Loop:
    """A task: its moves as (pose before, pose after), and the first run of each of its cycles."""

    moves: tuple[Token, ...]
    starts: tuple[int, ...]


def find_loops(runs: Sequence[Run]) -> list[Loop]:
    """Tasks by first occurrence; the loop that covers most runs is found first, then the other runs are searched."""
    tokens = _tokens(runs)
    free = np.ones(len(tokens), dtype=bool)
    found: list[Loop] = []
    while (best := _best(tokens, free, runs)) is not None:
        for start in best.starts:
            free[start : start + len(best.moves)] = False
        found.append(best)
    return sorted(found, key=lambda loop: loop.starts[0])


def closed_spans(runs: Sequence[Run], fewest: int) -> list[tuple[int, int]]:
    """First and last index in ``runs`` of each turn of a loop of at least ``fewest`` moves."""
    return sorted(_spans(_tokens(runs), 0, fewest))


def _spans(tokens: Sequence[Token], offset: int, fewest: int) -> list[tuple[int, int]]:
    """The turns of the longest loop, and of the loops before and after it."""
    first_from = {before: a for a, (before, _) in reversed(list(enumerate(tokens)))}
    reached = {after: b for b, (_, after) in enumerate(tokens)}
    closed = [(a, reached[pose]) for pose, a in first_from.items() if reached.get(pose, -1) - a + 1 >= fewest]
    if not closed:
        return []
    first, last = max(closed, key=lambda span: (span[1] - span[0], -span[0]))
    loop = tokens[first : last + 1]
    turn = next(k for k in range(1, len(loop) + 1) if _repeats(loop, k))
    turns = range(first, last + 1, turn) if turn >= fewest else range(first, last + 1, last + 1 - first)
    own = [(offset + k, offset + min(k + turns.step, last + 1) - 1) for k in turns]
    return _spans(tokens[:first], offset, fewest) + own + _spans(tokens[last + 1 :], offset + last + 1, fewest)


def _repeats(moves: Sequence[Token], k: int) -> bool:
    return len(moves) % k == 0 and list(moves[:k]) * (len(moves) // k) == list(moves)


def _tokens(runs: Sequence[Run]) -> list[Token]:
    poses: list[Float] = []
    return [(_node(poses, run.before), _node(poses, run.after)) for run in runs]


def _node(poses: list[Float], pose: Float) -> int:
    number = next((k for k, known in enumerate(poses) if np.abs(known - pose).max() <= SAME_POSE), len(poses))
    poses += [pose] if number == len(poses) else []
    return number


def _best(tokens: Sequence[Token], free: NDArray[np.bool_], runs: Sequence[Run]) -> Loop | None:
    """The loop that covers most runs; among equals, the one with the longest rests before it."""
    starts: dict[tuple[Token, ...], list[int]] = defaultdict(list)
    for start in range(len(tokens)):
        for end in range(start + 2, min(start + LONGEST, len(tokens)) + 1):
            if not free[end - 1] or not free[start] or tokens[end - 2][1] != tokens[end - 1][0]:
                break
            moves = tuple(tokens[start:end])
            if moves[0][0] == moves[-1][1] and (not starts[moves] or start >= starts[moves][-1] + len(moves)):
                starts[moves].append(start)
    loops = [Loop(m, tuple(s)) for m, s in starts.items() if len(s) >= FEWEST]
    loops.sort(key=lambda loop: (len(loop.moves) * len(loop.starts), _rest_before(loop, runs)), reverse=True)
    return next((loop for loop in loops if not _compound(loop, starts)), None)


def _compound(loop: Loop, starts: Mapping[tuple[Token, ...], Sequence[int]]) -> bool:
    """True if a loop repeats a shorter one, or is several tasks in sequence: a shorter one within it also occurs alone,
    or those between its passages of the start pose also occur in another order."""
    moves, n = loop.moves, len(loop.moves)
    if any(_repeats(moves, k) for k in range(1, n // 2 + 1)):
        return True
    inner = Counter(moves[a:b] for a in range(n) for b in range(a + 2, n + 1) if b - a < n)
    if any(len(starts.get(part, ())) - times * len(loop.starts) >= FEWEST for part, times in inner.items()):
        return True
    home = [k for k in range(n) if moves[k][0] == moves[0][0]]
    parts = [moves[a:b] for a, b in pairwise([*home, n])]
    orders = {*product(parts, repeat=2)} - {*pairwise([*parts, parts[0]])}
    learnt = all(len(part) > 1 and len(starts.get(part, ())) >= FEWEST for part in parts)
    return learnt and any(starts.get(one + next_, ()) for one, next_ in orders)


def _rest_before(loop: Loop, runs: Sequence[Run]) -> float:
    return float(np.median([runs[s].first - runs[s - 1].last for s in loop.starts if s > 0] or [0]))
