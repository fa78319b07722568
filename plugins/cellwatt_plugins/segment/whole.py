"""A whole recording cut at once: each stretch without a hole apart, by the workers of a scheduler if there is one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.results import Interval
from cellwatt_plugins.segment.intervals import Segmenter
from cellwatt_plugins.segment.motion import Thresholds
from cellwatt_plugins.segment.noise import first_that_counts

Float = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]


@dataclass(frozen=True)
class Cutting:
    """Arm whose intervals are cut, and how; ``step`` is that of its frames, ns."""

    source: str
    joints: int
    step: int
    thresholds: Thresholds

    def segmenter(self) -> Segmenter:
        """One that has seen nothing yet."""
        return Segmenter(self.source, self.joints, self.step, self.thresholds)


@dataclass(frozen=True)
class _Stretch:
    """Frames without a hole: ``time`` (n,) ns, ``positions`` (n, joints) rad, and those ``before`` that tell the noise
    of its first ones."""

    before: Float
    time: Nanoseconds
    positions: Float


def intervals_of(cutting: Cutting, time: Nanoseconds, positions: Float) -> list[Interval]:
    """Intervals of all frames, as a ``Segmenter`` gives them: ``time`` (n,) ns, ``positions`` (n, joints) rad."""
    from cellwatt.scheduler import spread  # of which a cell that cuts live needs nothing

    good = ~np.isnan(positions).any(axis=1)
    when, pose = time[good], positions[good]
    edges = [0, *(np.flatnonzero(np.diff(when) > cutting.segmenter().gap) + 1).tolist(), len(when)]
    stretches = [_Stretch(pose[first_that_counts(a) : a], when[a:b], pose[a:b]) for a, b in pairwise(edges) if b > a]
    out: list[Interval] = []
    for cut in spread(_cut, stretches, "cutting into intervals", shared=cutting):
        before = max((interval.number for interval in out), default=0)
        out += [replace(interval, number=before + interval.number) for interval in cut]
    return out


def _cut(stretch: _Stretch, cutting: Cutting) -> list[Interval]:
    segmenter = cutting.segmenter()
    segmenter.hear(stretch.before)
    return [*segmenter.update(stretch.time, stretch.positions), *segmenter.finish()]
