"""The expected course of a task at one speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cellwatt.results import Interval
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings, from_variant, resampled
from cellwatt_plugins.faults.reference import Reference

POSE = math.radians(3.0)
"""Largest difference of a joint's start position from the reference, rad …"""
ELSEWHERE = 2
"""… except for this number of joints, whose encoders may be faulty."""
FAR = 0.1
"""Mean distance, rad, at which a joint is off the course; a motion with half of its joints off matches no course."""

Key = tuple[str, float]
"""Name and speed of a task."""


@dataclass(frozen=True)
class Course:
    """The expected course of a task at one speed."""

    task: str
    speed: float
    intervals: tuple[ExpectedInterval, ...]

    @property
    def key(self) -> Key:
        """Name and speed of the task."""
        return self.task, self.speed

    @property
    def words(self) -> str:
        """``task_1 at speed 0.50``."""
        return f"{self.task} at speed {self.speed:.2f}"

    def begins_with(self, interval: Interval) -> bool:
        """True if a motion may be the first of this course: it has its start pose and moves only its joints."""
        first = self.intervals[0]
        off = np.abs(np.asarray(interval.pose) - first.readings.q[0]) > POSE
        return bool(interval.moving) and set(interval.moving) <= set(first.moving) and int(off.sum()) <= ELSEWHERE

    def misfit(self, readings: Readings, until: float) -> float:
        """Mean distance from this course from its start to ``until`` s, rad, summed over the joints; each joint counts
        at most ``FAR``, so that a faulty encoder does not decide."""
        expected = self.intervals[0].readings
        t = expected.t[expected.t <= until]
        off = np.abs(resampled(readings, t).q - expected.q[: len(t)]).mean(axis=0)
        return float(np.minimum(off, FAR).sum())


def courses_of(reference: Reference) -> list[Course]:
    """The course of every task of a reference at every learned speed."""
    return [
        Course(task.name, variant.speed, from_variant(variant)) for task in reference.tasks for variant in task.variants
    ]
