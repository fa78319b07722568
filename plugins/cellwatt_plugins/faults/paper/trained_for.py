"""The task of a network, stored in its file and compared with the tasks of a reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict

from cellwatt_plugins.faults.paper.course import Course

WAY = math.radians(3.0)
"""Largest difference of a joint's displacement in an interval from the trained task, rad …"""
PACE = 0.1
"""… and largest relative difference of the interval's duration: another speed is another task."""


@dataclass(frozen=True)
class TrainedFor:
    """A task at one speed: the ``moving`` joints (1-based) of each interval, the displacement (``way``) of every joint,
    rad, and the duration in ``seconds``."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    task: str
    speed: float
    joints: int
    moving: tuple[tuple[int, ...], ...]
    way: tuple[tuple[float, ...], ...]
    seconds: tuple[float, ...]

    @classmethod
    def of(cls, course: Course) -> TrainedFor:
        """The task of a course."""
        each = [interval.readings for interval in course.intervals]
        return cls(
            task=course.task,
            speed=course.speed,
            joints=each[0].q.shape[1],
            moving=tuple(interval.moving for interval in course.intervals),
            way=tuple(tuple(np.round(readings.q[-1] - readings.q[0], 4).tolist()) for readings in each),
            seconds=tuple(round(interval.end - interval.start, 3) for interval in course.intervals),
        )

    def differs(self, course: Course) -> str:
        """Describe the first difference between a course and the task; empty if there is none."""
        other = TrainedFor.of(course)
        if (other.joints, len(other.moving)) != (self.joints, len(self.moving)):
            return f"{other.joints} joints, {len(other.moving)} intervals, expected {self.joints}, {len(self.moving)}"
        for number, (mine, its) in enumerate(zip(self.moving, other.moving, strict=True), start=1):
            if mine != its:
                return f"other joints in motion in interval {number}: {_words(its)}, expected {_words(mine)}"
        way = np.abs(np.subtract(self.way, other.way)).max(axis=1) > WAY
        pace = np.abs(np.divide(other.seconds, self.seconds) - 1) > PACE
        for what, off in (("way", way), ("pace", pace)):
            if off.any():
                return f"another {what} in interval {int(np.argmax(off)) + 1}"
        return ""


def _words(moving: Sequence[int]) -> str:
    return ", ".join(map(str, moving)) or "none"
