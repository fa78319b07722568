"""Where in the reference the arm is: by the set of moving joints, the start pose and the place in the sequence."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cellwatt.results import Interval
from cellwatt_plugins.faults.reference import Reference, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

POSE = math.radians(3.0)
"""A joint starts from the pose of the reference up to this difference, rad."""
MISFIT = 0.1
"""Mean position difference, rad, that weighs as much as one joint in the wrong pose."""


@dataclass(frozen=True, slots=True)
class Place:
    """An interval of the reference: indices of task, variant and interval."""

    task: int
    variant: int
    index: int


@dataclass(frozen=True, slots=True)
class Match:
    """A place that an interval may be.

    ``foreign`` joints move in only one of the two, ``displaced`` joints start elsewhere; ``skipped`` reference
    intervals lie between the last place and this one (``None``: no sequence to follow).
    """

    place: Place
    foreign: int
    displaced: int
    skipped: int | None


@dataclass
class Follower:
    """Follows one arm through the reference; ``last`` is the place of the last interval that was recognised."""

    reference: Reference
    last: Place | None = None

    def __getitem__(self, place: Place) -> ReferenceInterval:
        return self.reference.tasks[place.task].variants[place.variant].intervals[place.index]

    def places(self) -> Iterator[Place]:
        """Every interval of the reference."""
        for i, task in enumerate(self.reference.tasks):
            for k, variant in enumerate(task.variants):
                yield from (Place(i, k, index) for index in range(len(variant.intervals)))

    def after(self, place: Place, steps: int = 1) -> Place:
        """The place ``steps`` later in the same task, which repeats."""
        length = len(self.reference.tasks[place.task].variants[place.variant].intervals)
        return Place(place.task, place.variant, (place.index + steps) % length)

    def best(self, interval: Interval, trace: Trace) -> Match | None:
        """The place that an interval, open or closed, most likely is; ``None`` where none will do."""
        scored = [(self._misfit(match, interval, trace), match) for match in self._matches(interval)]
        return min(scored, key=lambda entry: entry[0])[1] if scored else None

    def _matches(self, interval: Interval) -> Iterator[Match]:
        for place in self.places():
            reference = self[place]
            foreign = len(set(interval.moving) ^ set(reference.moving))
            pairs = zip(interval.pose, reference.pose, strict=True)
            displaced = sum(abs(a - b) > POSE for a, b in pairs)
            skipped = self._skipped(place)
            in_sequence = skipped is not None
            if (foreign == 0 and displaced <= 1 + in_sequence) or (foreign == 1 and displaced <= 1 and skipped == 0):
                yield Match(place, foreign, displaced, skipped)

    def _skipped(self, place: Place) -> int | None:
        """0 for the place after the last, 1 if one interval was left out, at any speed of the same task."""
        if self.last is None or self.last.task != place.task:
            return None
        for skipped in (0, 1):
            if self.after(Place(place.task, place.variant, self.last.index), skipped + 1) == place:
                return skipped
        return None

    def _misfit(self, match: Match, interval: Interval, trace: Trace) -> float:
        """Small is good: 1 for a joint that starts elsewhere, 2 for a foreign one, plus how far the path is off."""
        reference = self[match.place]
        so_far = trace.between(interval.start, interval.end)
        t = so_far.since(interval.start)
        errors = [
            np.abs(so_far.position[:, joint - 1] - pattern.at(t)) for joint, pattern in reference.position.items()
        ]
        path = float(np.nanmean(errors)) / MISFIT if len(t) and not np.isnan(errors).all() else 0.0
        order = {None: 0.5, 0: 0.0, 1: 0.25}[match.skipped]
        return path + match.displaced + 2.0 * match.foreign + order
