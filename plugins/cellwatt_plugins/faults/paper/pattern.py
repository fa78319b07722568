"""Power of a whole healthy cycle as one curve from a learned reference, or from equations (17)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper.course import Course, Key
from cellwatt_plugins.faults.paper.equation import PowerEquation, load
from cellwatt_plugins.faults.reference import LEAD, TAIL, Variant

OFF = 0.15
"""Largest difference between the durations of an equation and its task, s; beyond it, it is of another reference."""


def cycle_pattern(variant: Variant) -> tuple[Float, Float]:
    """Evenly spaced times (n,) s from the start of the first motion to the end of the last, and the mean power (n,) W.

    A rest between two motions has the learned power at its ends and a straight line between them.
    """
    times, powers, start = [], [], 0.0
    rests = [0.0, *(interval.rest for interval in variant.intervals[1:]), 2 * TAIL]
    for interval, before, after in zip(variant.intervals, rests, rests[1:], strict=False):
        start += before
        own = interval.power.time
        kept = (own >= -min(LEAD, before / 2)) & (own < interval.duration + min(TAIL, after / 2))
        times.append(start + own[kept])
        powers.append(interval.power.values[kept])
        start += interval.duration
    t = np.arange(0.0, start, variant.intervals[0].power.step)
    return t, np.asarray(np.interp(t, np.concatenate(times), np.concatenate(powers)), dtype=np.float64)


def by_equations(courses: Sequence[Course], folder: Path) -> list[Course]:
    """The courses with the power of the equations in a folder instead of the mean of healthy cycles.

    Raises ``ModelError`` if a course has no equation or one of another length, or an equation names no task.
    """
    found: dict[Key, PowerEquation] = {}
    for file in sorted(folder.glob("*.yaml")):
        equation = load(file)
        if equation.task is None or equation.speed is None:
            raise ModelError(f"power equation {file}: names no task and speed")
        found[equation.task, equation.speed] = equation
    out = []
    for course in courses:
        each, end = found.get(course.key), course.intervals[-1].end
        if each is None:
            raise ModelError(
                f"power equations {folder}: none is of {course.words}; make them with `cellwatt train pattern`"
            )
        if abs(each.duration - end) > OFF:
            raise ModelError(
                f"power equations {folder}: that of {course.words} is {each.duration:.2f} s long, the task {end:.2f} "
                "s: it is of another reference; make it anew with `cellwatt train pattern`"
            )
        intervals = [replace(i, readings=replace(i.readings, power=each.power(i.readings.t))) for i in course.intervals]
        out.append(replace(course, intervals=tuple(intervals)))
    return out
