"""Finds known cycles in runs of motion, also where one or two encoders do not show their joint's path."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.pattern import Pattern, Timing, Warp, timing, warp_of
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, without_jumps

Float = NDArray[np.float64]

POSE = math.radians(0.4)
"""A rest pose this far from the pattern's, in any joint, is another …"""
REPEAT = 8.0
"""… or so many standard deviations of healthy rest poses."""
WAY = math.radians(2.0)
"""A joint that goes less far in a move does not time it."""
MOST_ODD = 2
"""Joints that may be off their path in a known cycle."""
FEWEST_SEEN = 0.5
"""Share of a cycle's moves that must be seen."""
FEWEST_BEGUN = 1
"""Moves of a cycle under way that must be seen, and one more for each joint off its path."""
EVEN = 0.03
"""A move that the pattern's timing misses by more than this, s, was interrupted."""
SLOWEST, FASTEST = 0.2, 2.5
"""Pace relative to the pattern within which a move is that of the pattern."""


@dataclass(frozen=True)
class Match:
    """A known cycle: ``pattern`` index, runs ``first`` to ``last`` (index), ``odd`` joints (0-based) off their path,
    ``warp`` to the pattern, moves that are ``unseen`` or ``broken`` by a stop, ``pace`` relative to the pattern."""

    pattern: int
    first: int
    last: int
    odd: tuple[int, ...]
    warp: Warp
    unseen: tuple[int, ...]
    broken: tuple[int, ...]
    pace: float


@dataclass(frozen=True, slots=True)
class _Step:
    """A move of the pattern and the runs (first, last index) that make it; None where none is seen."""

    move: int
    runs: tuple[int, int] | None


def find_cycles(recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern]) -> list[Match]:
    """Known cycles in the order of their runs; what lies between them is something else."""
    found: list[Match] = []
    recording = replace(recording, position=without_jumps(recording.position))
    at = 0
    while at < len(runs):
        match = _match_at(recording, runs, patterns, at)
        if match is None:
            at += 1
        else:
            found.append(match)
            at = match.last + 1
    return found


def begun_cycle(recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern]) -> Match | None:
    """The known cycle that is under way after the last run, as far as it has gone; None where it may be of two tasks.

    Its last move is that of the last run, so it must have ended.
    """
    recording = replace(recording, position=without_jumps(recording.position))
    for number in range(MOST_ODD + 1):
        for at in range(len(runs)):
            options = _options(recording, runs, patterns, at, number, whole=False)
            options = [match for match in options if match.last == len(runs) - 1]
            if options:
                one_task = len({patterns[match.pattern].task for match in options}) == 1
                return _best(options) if one_task else None
    return None


def _match_at(recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern], at: int) -> Match | None:
    """The cycle that begins with a run: with the fewest joints off their path, at the pace most like its pattern's."""
    for number in range(MOST_ODD + 1):
        if options := _options(recording, runs, patterns, at, number, whole=True):
            return _best(options)
    return None


def _best(options: Iterable[Match]) -> Match:
    return max(options, key=lambda m: (-len(m.broken), m.last - m.first, -abs(math.log(m.pace))))


def _options(
    recording: Recording, runs: Sequence[Run], patterns: Sequence[Pattern], at: int, number: int, *, whole: bool
) -> list[Match]:
    """Cycles, whole or begun, that begin with a run while ``number`` joints are off their path."""
    out: list[Match] = []
    for index, pattern in enumerate(patterns):
        far = _far(runs[at], pattern)
        others = [joint for joint in range(recording.joints) if joint not in far]
        for more in combinations(others, number - len(far)) if len(far) <= number else ():
            odd = tuple(sorted((*far, *more)))
            steps = _walk(runs, pattern, at, odd, whole=whole)
            match = None if steps is None else _timed(recording, runs, pattern, index, steps, odd)
            out += [] if match is None else [match]
    return out


def _far(run: Run, pattern: Pattern) -> list[int]:
    """Joints (0-based) too far from where the pattern begins, even if its first move is not seen."""
    limit = np.maximum(POSE, REPEAT * pattern.repeat) + WAY
    far: list[int] = np.flatnonzero(np.abs(run.before - pattern.poses[0][0]) > limit).tolist()
    return far


def _walk(runs: Sequence[Run], pattern: Pattern, at: int, odd: Sequence[int], *, whole: bool) -> list[_Step] | None:
    """Run by run through the moves of a pattern, looking only at joints that are not ``odd``.

    Where no ``whole`` cycle is wanted, as far as runs go.
    """
    keep = np.array([j for j in range(len(pattern.repeat)) if j not in odd])
    limit = np.maximum(POSE, REPEAT * pattern.repeat)[keep]
    before, after = pattern.poses[0][:, keep], pattern.poses[1][:, keep]
    shown: list[bool] = np.any(pattern.ways[:, keep] > WAY, axis=1).tolist()
    steps: list[_Step] = []
    for move in range(len(shown)):
        if at == len(runs) and not whole:
            break
        begins = at < len(runs) and _is(runs[at].before[keep], before[move], limit)
        still = begins and _is(runs[at].before[keep], runs[at].after[keep], limit)
        if not shown[move]:
            steps.append(_Step(move, None))
            at += still
            continue
        end = _end(runs, at, keep, after[move], limit)
        if not begins or still or end is None:
            return None
        steps.append(_Step(move, (at, end)))
        at = end + 1
    fewest = max(2, FEWEST_SEEN * len(steps)) if whole else FEWEST_BEGUN + len(odd)
    return steps if sum(s.runs is not None for s in steps) >= fewest else None


def _end(runs: Sequence[Run], at: int, keep: NDArray[np.intp], after: Float, limit: Float) -> int | None:
    """The run that ends a move begun with run ``at``: that one, or the next where the move stopped on its way."""
    if at < len(runs) and _is(runs[at].after[keep], after, limit):
        return at
    if at + 1 >= len(runs):
        return None
    on = runs[at + 1]
    goes_on = _is(runs[at].after[keep], on.before[keep], limit) and not _is(on.before[keep], on.after[keep], limit)
    return at + 1 if goes_on and _is(on.after[keep], after, limit) else None


def _is(pose: Float, other: Float, limit: Float) -> bool:
    return bool((np.abs(pose - other) < limit).all())


def _timed(
    recording: Recording, runs: Sequence[Run], pattern: Pattern, index: int, steps: Sequence[_Step], odd: Sequence[int]
) -> Match | None:
    """The match with its time map; None where its pace is not that of one task."""
    joints = [j for j in range(recording.joints) if j not in odd]
    timings: list[tuple[int, Timing]] = []
    broken = []
    for move, (first, last) in _seen(steps):
        found = timing(pattern, move, recording, (runs[first].first, runs[last].last), joints)
        timings.append((move, found))
        if last > first or found.error > EVEN:
            broken.append(move)
    paces = [_length(pattern, m) / (t.end - t.start) for m, t in timings if m not in broken and t.end > t.start]
    if not paces or not all(SLOWEST < p < FASTEST for p in paces):
        return None
    seen = [r for _, r in _seen(steps)]
    return Match(
        pattern=index,
        first=seen[0][0],
        last=seen[-1][1],
        odd=tuple(odd),
        warp=warp_of(pattern, timings),
        unseen=tuple(s.move for s in steps if s.runs is None),
        broken=tuple(broken),
        pace=float(np.median(paces)),
    )


def _seen(steps: Sequence[_Step]) -> Iterator[tuple[int, tuple[int, int]]]:
    for step in steps:
        if step.runs is not None:
            yield step.move, step.runs


def _length(pattern: Pattern, move: int) -> float:
    start, end = pattern.moves[move]
    return end - start
