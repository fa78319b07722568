"""Finds the reference interval that the arm runs, by the moving joints, the start pose and the sequence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.results import Interval
from cellwatt_plugins.faults.reference import Reference, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

POSE = math.radians(3.0)
"""Largest difference between start poses of one interval, per joint, rad."""
MISFIT = 0.1
"""Mean position difference, rad, with the weight of one joint in a wrong start pose."""


@dataclass(frozen=True, slots=True)
class IntervalKey:
    """An interval of the reference: indices of task, variant and interval."""

    task: int
    variant: int
    index: int


@dataclass(frozen=True, slots=True)
class Match:
    """A reference interval that a measured interval may be.

    ``foreign``: joints that move in only one of the two; ``displaced``: joints with another start pose; ``skipped``:
    reference intervals between the last recognised one and this one (``None``: no sequence).
    """

    key: IntervalKey
    foreign: int
    displaced: int
    skipped: int | None


@dataclass
class Follower:
    """Follows one arm through the reference; ``last`` is the interval recognised last."""

    reference: Reference
    last: IntervalKey | None = None

    def __post_init__(self) -> None:
        self._keys = [
            IntervalKey(i, k, index)
            for i, task in enumerate(self.reference.tasks)
            for k, variant in enumerate(task.variants)
            for index in range(len(variant.intervals))
        ]
        self._poses = np.array([self[key].pose for key in self._keys])
        self._moving = np.array([self._set(self[key].moving) for key in self._keys])

    def __getitem__(self, key: IntervalKey) -> ReferenceInterval:
        return self.reference.tasks[key.task].variants[key.variant].intervals[key.index]

    def _set(self, joints: Sequence[int]) -> list[bool]:
        return [joint in joints for joint in range(1, self.reference.joints + 1)]

    def after(self, key: IntervalKey, steps: int = 1) -> IntervalKey:
        """The interval ``steps`` later in the same task, which repeats."""
        length = len(self.reference.tasks[key.task].variants[key.variant].intervals)
        return IntervalKey(key.task, key.variant, (key.index + steps) % length)

    def best(self, interval: Interval, trace: Trace) -> Match | None:
        """The most likely match of an open or closed interval; ``None`` if no reference interval matches."""
        scored = [(self._misfit(match, interval, trace), match) for match in self._matches(interval)]
        return min(scored, key=lambda entry: entry[0])[1] if scored else None

    def _matches(self, interval: Interval) -> Iterator[Match]:
        foreign = (self._moving ^ np.array(self._set(interval.moving))).sum(axis=1)
        displaced = (np.abs(self._poses - np.asarray(interval.pose)) > POSE).sum(axis=1)
        for k in np.flatnonzero((foreign <= 1) & (displaced <= 2)).tolist():
            skipped = self._skipped(self._keys[k])
            most = 2 if foreign[k] == 0 and skipped is not None else 1
            if displaced[k] <= most and (foreign[k] == 0 or skipped == 0):
                yield Match(self._keys[k], int(foreign[k]), int(displaced[k]), skipped)

    def _skipped(self, key: IntervalKey) -> int | None:
        """0 for the interval after the last, 1 if one was skipped, at any speed of the same task; else ``None``."""
        if self.last is None or self.last.task != key.task:
            return None
        for skipped in (0, 1):
            if self.after(IntervalKey(key.task, key.variant, self.last.index), skipped + 1) == key:
                return skipped
        return None

    def _misfit(self, match: Match, interval: Interval, trace: Trace) -> float:
        """Cost of a match: 1 per displaced joint (2 out of sequence), 2 per foreign joint, plus path and order."""
        reference = self[match.key]
        so_far = trace.between(interval.start, interval.end)
        t = so_far.since(interval.start)
        errors = [
            np.abs(so_far.position[:, joint - 1] - pattern.at(t)) for joint, pattern in reference.position.items()
        ]
        path = float(np.nanmean(errors)) / MISFIT if len(t) and not np.isnan(errors).all() else 0.0
        order = {None: 0.5, 0: 0.0, 1: 0.25}[match.skipped]
        displaced = match.displaced * (1.0 if match.skipped is not None else 2.0)
        return path + displaced + 2.0 * match.foreign + order
