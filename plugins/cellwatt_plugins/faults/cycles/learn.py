"""Learns a pattern of healthy cycles for each task and speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ModelError
from cellwatt_plugins.faults.cycles.loops import find_loops
from cellwatt_plugins.faults.cycles.metering import power_through
from cellwatt_plugins.faults.cycles.pattern import MARGIN, Pattern, Timing, timing, warp_of
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, find_runs
from cellwatt_plugins.faults.learn import by_speed, over_cycles
from cellwatt_plugins.robot.samples import interpolated

STEP = 0.02
"""Sample interval of the patterns, s."""
SAME_SPEED = 1.06
"""Largest ratio of moving times between cycles at one speed."""
FEWEST = 2
"""Fewest cycles at one speed."""


def learn_patterns(recording: Recording) -> list[Pattern]:
    """Learn the pattern of every task and speed seen often enough.

    Raises ``ModelError`` if no task recurs.
    """
    runs = find_runs(recording)
    patterns: list[Pattern] = []
    for number, loop in enumerate(find_loops(runs), start=1):
        first = len(patterns)
        cycles = [runs[start : start + len(loop.moves)] for start in loop.starts]
        for group in by_speed(cycles, lambda cycle: float(sum(run.last - run.first for run in cycle)), SAME_SPEED):
            if len(group) < FEWEST:
                continue
            pattern = _pattern(recording, group, f"task_{number}")
            fastest = patterns[first] if len(patterns) > first else pattern
            patterns.append(replace(pattern, speed=_speed(recording, group[0], fastest)))
    if not patterns:
        raise ModelError("no task was seen three times or more, twice at one speed: record more healthy cycles")
    return patterns


def _speed(recording: Recording, cycle: Sequence[Run], fastest: Pattern) -> float:
    """Speed of a cycle relative to the pattern ``fastest``."""
    times = _timings(fastest, recording, cycle)
    shares = [(b - a) / (t.end - t.start) for (a, b), t in zip(fastest.moves, times, strict=True)]
    return round(float(np.median(shares)), 3)


def _timings(pattern: Pattern, recording: Recording, cycle: Sequence[Run]) -> list[Timing]:
    """When each move of a pattern was in a cycle, by all joints."""
    spans = enumerate((run.first, run.last) for run in cycle)
    return [timing(pattern, move, recording, span, range(recording.joints)) for move, span in spans]


def _pattern(recording: Recording, group: Sequence[Sequence[Run]], task: str) -> Pattern:
    """Align the cycles with the one of median duration, and average them."""
    middle = sorted(group, key=lambda c: c[-1].last - c[0].first)[len(group) // 2]
    template = _cut(recording, middle, task)
    warps = [warp_of(template, list(enumerate(_timings(template, recording, cycle)))) for cycle in group]
    whens = [warp.to_recording(template.time) for warp in warps]
    position = np.mean([interpolated(when, recording.time, recording.position) for when in whens], axis=0)
    if recording.meter is not None and recording.readings is not None:
        power, spread = power_through(recording.meter, recording.readings, template, warps)
    else:
        power, spread = over_cycles(np.array([_power(template, recording, when) for when in whens]), "power is")
    rests = np.array([[run.after for run in cycle] for cycle in group])
    repeat = rests.std(axis=0, ddof=1).max(axis=0)
    return replace(template, cycles=len(warps), position=_smooth(position), power=power, spread=spread, repeat=repeat)


def _cut(recording: Recording, cycle: Sequence[Run], task: str) -> Pattern:
    """Resample one cycle as a pattern without power."""
    begin = recording.time[cycle[0].first] - MARGIN
    length = recording.time[cycle[-1].last] + MARGIN - begin
    grid = begin + STEP * np.arange(round(length / STEP) + 1)
    position = interpolated(grid, recording.time, recording.position)
    moves = tuple((float(recording.time[run.first] - begin), float(recording.time[run.last] - begin)) for run in cycle)
    nothing = np.zeros(len(grid))
    return Pattern(task, 1.0, 1, STEP, moves, np.zeros(recording.joints), nothing, nothing, position)


def _power(pattern: Pattern, recording: Recording, when: Float) -> Float:
    """Power (T,) W of a cycle at times ``when`` (T,) s of the pattern's samples, averaged over the pattern's step."""
    width = max(1, round(pattern.step / recording.step))
    power = np.convolve(recording.power, np.ones(width) / width, mode="same")
    centre = recording.time - (0.5 * recording.step if width % 2 == 0 else 0.0)
    return np.interp(when, centre, power)


def _smooth(position: Float) -> Float:
    """Smooth residual encoder noise with a local parabola over five samples."""
    kernel = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
    padded = np.pad(position, ((2, 2), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])
