"""Learns the healthy intervals of each task and the spread of their power, for the paper's method."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ModelError
from cellwatt.results import Interval, Task
from cellwatt_plugins.faults.reference import (
    LEAD,
    TAIL,
    Pattern,
    ReferenceInterval,
    TaskReference,
    Variant,
)
from cellwatt_plugins.faults.trace import Trace

T = TypeVar("T")

FEWEST = 3
"""Fewest cycles from which a variant is learned."""
SAME_SPEED = 0.03
"""Largest relative difference of moving time between cycles of one variant."""
LEAST_WAY = math.radians(2.0)
"""An interval is compared only if a joint moves by more than this, rad."""


def learn(step: float, trace: Trace, intervals: Sequence[Interval], tasks: Sequence[Task]) -> tuple[TaskReference, ...]:
    """Learn every task variant seen ``FEWEST`` times or more, as patterns with a step of ``step`` s.

    ``intervals`` and ``tasks`` are the results of the segment stage for the frames of ``trace``. Raises
    ``ModelError`` if no task recurs often enough.
    """
    by_number = {i.number: i for i in intervals if i.closed}
    learned: list[TaskReference] = []
    for name in sorted({t.name for t in tasks}):
        runs = [t for t in tasks if t.name == name]
        cycles = _alike([[by_number[n] for n in run.intervals if n in by_number] for run in runs])
        variants = _variants(step, trace, cycles)
        if variants:
            learned.append(TaskReference(f"task_{len(learned) + 1}", runs[0].signature, tuple(variants)))
    if not learned:
        if not tasks:
            raise ModelError(
                "no task was found: two healthy cycles or more must follow each other in one recording or table"
            )
        seen = max(Counter(task.name for task in tasks).values())
        raise ModelError(
            f"no task was seen {FEWEST} times or more at one speed (most: {seen}): record more healthy cycles"
        )
    return tuple(learned)


def _alike(cycles: Sequence[Sequence[Interval]]) -> list[Sequence[Interval]]:
    """The cycles with the most common sequence of sets of moving joints."""
    sets = [tuple(interval.moving for interval, _ in _moves(cycle)) for cycle in cycles]
    common, _ = Counter(sets).most_common(1)[0]
    return [cycle for cycle, found in zip(cycles, sets, strict=True) if found == common]


def _variants(step: float, trace: Trace, cycles: Sequence[Sequence[Interval]]) -> list[Variant]:
    """Variants of one task, fastest first; ``cycles`` include the intervals at rest."""
    kept = [group for group in by_speed(cycles, _moving_time, 1 + SAME_SPEED) if len(group) >= FEWEST]
    if not kept:
        return []
    fastest = float(np.median([_moving_time(c) for c in kept[0]]))
    return [
        Variant(
            speed=round(fastest / float(np.median([_moving_time(c) for c in group])), 3),
            cycles=len(group),
            intervals=tuple(
                _interval(step, trace, [_moves(c)[k] for c in group]) for k in range(len(_moves(group[0])))
            ),
        )
        for group in kept
    ]


def by_speed(cycles: Iterable[T], seconds: Callable[[T], float], alike: float) -> list[list[T]]:
    """Group cycles of a task by speed, fastest first; a group spans at most ``alike`` times its shortest duration."""
    groups: list[list[T]] = []
    for cycle in sorted(cycles, key=seconds):
        if groups and seconds(cycle) <= alike * seconds(groups[-1][0]):
            groups[-1].append(cycle)
        else:
            groups.append([cycle])
    return groups


def _moves(cycle: Sequence[Interval]) -> list[tuple[Interval, float]]:
    """The moving intervals of a cycle, each with the rest before it, s."""
    out, rest = [], 0.0
    for interval in cycle:
        seconds = (interval.end - interval.start) * 1e-9
        if max(map(abs, interval.displacement)) > LEAST_WAY:
            out.append((interval, rest))
            rest = 0.0
        else:
            rest += seconds
    return out


def _moving_time(cycle: Sequence[Interval]) -> float:
    return sum(interval.end - interval.start for interval, _ in _moves(cycle)) * 1e-9


def _interval(step: float, trace: Trace, runs: Sequence[tuple[Interval, float]]) -> ReferenceInterval:
    """Combine one interval of every cycle into an interval of the reference."""
    intervals = [interval for interval, _ in runs]
    duration = float(np.median([i.end - i.start for i in intervals])) * 1e-9
    t = np.asarray(-LEAD + step * np.arange(round((LEAD + duration + TAIL) / step) + 1), dtype=np.float64)
    moving = intervals[0].moving
    powers = [_sampled(trace, i.start, t, trace.power) for i in intervals]
    positions: Mapping[int, list[Float]] = {
        j: [_sampled(trace, i.start, t, trace.position[:, j - 1]) for i in intervals] for j in moving
    }
    return ReferenceInterval(
        moving=moving,
        pose=_median([i.pose for i in intervals]),
        displacement=_median([i.displacement for i in intervals]),
        duration=duration,
        rest=float(np.median([rest for _, rest in runs])),
        cycles=len(runs),
        power=_pattern(step, powers),
        position={j: _pattern(step, rows) for j, rows in positions.items()},
    )


def _sampled(trace: Trace, onset: int, t: Float, values: Float) -> Float:
    """Interpolate values at times t (n,) s from an onset (ns); NaN beyond the frames or where values are missing."""
    low, high = np.searchsorted(trace.time, [onset + int(t[0] * 1e9) - 10**9, onset + int(t[-1] * 1e9) + 10**9])
    near = (trace.time[low:high] - onset) * 1e-9
    return np.interp(t, near, values[low:high], left=np.nan, right=np.nan)


def _pattern(step: float, rows: Sequence[Float]) -> Pattern:
    mean, spread = over_cycles(np.stack(rows), "power or positions are")
    return Pattern(-LEAD, step, tuple(mean.tolist()), tuple(spread.tolist()))


def over_cycles(values: Float, what: str) -> tuple[Float, Float]:
    """Mean and standard deviation (n,) over the cycles that have a value, of (cycles, n).

    Raises ``ModelError``, in which ``what`` stands for the values, if a point was measured in no cycle.
    """
    count = np.sum(~np.isnan(values), axis=0)
    if not count.all():
        raise ModelError(f"{what} missing at the same point of every healthy cycle: check the recording")
    mean = np.nansum(values, axis=0) / count
    return mean, np.sqrt(np.nansum((values - mean) ** 2, axis=0) / np.maximum(count - 1, 1))


def _median(poses: Sequence[Sequence[float]]) -> tuple[float, ...]:
    return tuple(np.median(np.asarray(poses), axis=0).tolist())
