"""Cuts motion into intervals by the set of moving joints, from encoder positions alone (Sabry et al., section V.A)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from cellwatt.arrays import Float, Nanoseconds
from cellwatt.results import Interval
from cellwatt_plugins.segment.moving_joints import Change, MovingJoints, Sample
from cellwatt_plugins.segment.settings import SegmentSettings

TURN_REACH = 0.25
TURN_DEPTH = 0.15
"""The arm turns where its fastest joint drops below ``TURN_DEPTH`` of its speed ``TURN_REACH`` s before and after."""
LINGER = 1.0
"""Longest time in s that joints may stop after the others and still end the same interval."""


@dataclass(slots=True)
class _Open:
    """The running interval; ``peak`` (joints,) rad/s is each joint's highest speed in the samples counted so far."""

    number: int
    moving: int
    first: Sample
    peak: Float
    complete: bool


@dataclass
class Segmenter:
    """Cuts frames into intervals as they arrive; the size of the blocks does not change the intervals.

    ``step`` is the frame step in ns. Each interval is reported open as soon as its moving set is confirmed
    (``end`` is then the time of the confirming frame; it is reported again if a joint joins late), and closed with
    its exact start and end. Neighbouring intervals share their boundary. If the arm rests for less than the minimum
    length, or stops briefly to turn, two moving intervals follow each other, possibly with the same joints.
    """

    source: str
    joints: int
    step: int
    thresholds: SegmentSettings = field(default_factory=SegmentSettings)

    def __post_init__(self) -> None:
        self._motion = MovingJoints(self.joints, self.step, self.thresholds)
        self._minimum = round(self.thresholds.minimum_length * 1e9)
        self._gap = max(round(self.thresholds.gap * 1e9), self.step + self.step // 2)
        self._reach = max(2, round(TURN_REACH * 1e9 / self.step))
        self._number = 0
        self._out: list[Interval] = []
        self._reset()

    def _reset(self) -> None:
        self._motion.reset()
        self._open: _Open | None = None
        self._announced = False
        self._uncounted: deque[Sample] = deque()
        self._turned: Sample | None = None

    def update(self, time: Nanoseconds, positions: Float) -> list[Interval]:
        """Return the intervals opened or closed by n more frames: ``time`` (n,) ns, ``positions`` (n, joints) rad, NaN
        where missing."""
        good = ~np.isnan(positions).any(axis=1)
        when, pose = time[good], positions[good]
        last = self._motion.time[-1:] if len(self._motion.time) else when[:1]
        for piece in np.split(np.arange(len(when)), np.flatnonzero(np.diff(when, prepend=last) > self._gap)):
            if len(piece):
                self._cut_if_lost(int(when[piece[0]]))
                for sample in self._motion.feed(when[piece], pose[piece]):
                    self._step(sample)
        if len(time):
            self._cut_if_lost(int(time[-1]))
        return self._take()

    def finish(self) -> list[Interval]:
        """Close the interval that the end of the data interrupts."""
        self._cut()
        return self._take()

    def _take(self) -> list[Interval]:
        out, self._out = self._out, []
        return out

    def _cut_if_lost(self, now: int) -> None:
        if len(self._motion.time) and now - self._motion.time[-1] > self._gap:
            self._cut()

    def _cut(self) -> None:
        """Close the open interval as incomplete at the last frame, at the end of the data or before a hole."""
        if self._open is not None:
            self._open.complete = False
            last = self._motion.trail[-1]
            self._close(replace(last, time=last.seen, pose=last.last_pose))
        self._reset()

    def _step(self, sample: Sample) -> None:
        """Process one sample: count its speed, and check whether the moving set has settled or the arm has turned."""
        motion, changes = self._motion, self._motion.changes
        if self._open is None:
            self._begin(motion.moving, sample, complete=False)
        self._uncounted.append(sample)
        if len(self._uncounted) > motion.length and not changes:
            self._count(self._uncounted.popleft())
        self._look_for_turn()
        if motion.undecided:
            return
        last = max((c.sample.time for c in changes), default=self._current.first.time)
        if sample.time - last >= self._minimum or (changes and not motion.moving):
            self._settle(sample)
        if not changes and self._turned is not None:
            self._turn(self._turned, sample)
            self._turned = None

    @property
    def _current(self) -> _Open:
        assert self._open is not None
        return self._open

    def _settle(self, sample: Sample) -> None:
        """The set of moving joints has lasted long enough: cut where it changed, and announce the open interval."""
        groups = self._groups()
        if groups and self._leaves_little(groups[-1], sample):
            return
        for group in groups:
            self._transit(group)
        self._motion.changes.clear()
        if self._current.moving or sample.time - self._current.first.time >= self._minimum:
            self._announce(sample)

    def _groups(self) -> list[list[Change]]:
        """Changes in the order of their true times, grouped where only negligible motion lies between them."""
        groups: list[list[Change]] = []
        moving = self._current.moving
        for change in sorted(self._motion.changes, key=lambda c: c.sample.time):
            if groups and moving and self._negligible(groups[-1][-1].sample, change.sample):
                groups[-1].append(change)
            else:
                groups.append([change])
            moving = _after(moving, [change])
        return groups

    def _negligible(self, a: Sample, b: Sample) -> bool:
        """True if the motion between two samples is too short or too small to be an interval."""
        return b.time - a.time < self._minimum or _travel(a, b) < self.thresholds.minimum_travel

    def _leaves_little(self, group: list[Change], sample: Sample) -> bool:
        """True if some joints stopped just before the others, which have hardly moved since: wait for these to stop.

        The wait is at most ``LINGER``, as a joint that vibrates may neither stop nor move any further.
        """
        if not self._motion.moving or any(c.started for c in group):
            return False
        stop = group[-1].sample
        return sample.time - stop.time < LINGER * 1e9 and _travel(stop, sample) < self.thresholds.minimum_travel

    def _transit(self, group: list[Change]) -> None:
        """Change from one set of moving joints to the next, at the boundary of a group of changes."""
        current = self._current
        old, new = current.moving, _after(current.moving, group)
        if new == old:
            return
        boundary = max(_boundary(old, new, group), current.first, key=lambda s: s.time)
        joined = bool(old) and new & old == old
        if boundary is current.first or (joined and self._negligible(current.first, boundary)):
            current.moving = new
            self._announced = False
        elif not old and not self._announced and current.complete:
            self._number -= 1
            self._begin(new, boundary, complete=True)
        else:
            self._close(boundary)
            self._begin(new, boundary, complete=True)

    def _look_for_turn(self) -> None:
        """Find a turn: the whole arm stopped, for too short a time to be an interval at rest."""
        trail, reach = self._motion.trail, self._reach
        if len(trail) <= 2 * reach:
            return
        before, low, after = trail[-2 - reach], trail[-1 - reach], trail[-reach]
        if low.fastest > min(before.fastest, after.fastest):
            return
        peaks = [max(trail[i].fastest for i in span) for span in (range(-2 * reach - 1, -1 - reach), range(-reach, 0))]
        if _travel(before, after) / ((after.time - before.time) * 1e-9) < TURN_DEPTH * min(peaks):
            self._turned = low

    def _turn(self, low: Sample, sample: Sample) -> None:
        """Cut at a turn within the open interval."""
        if self._current.moving and low.time - self._current.first.time >= self._minimum:
            self._close(low)
            self._begin(self._motion.moving, low, complete=True)
            self._announce(sample)

    def _begin(self, moving: int, first: Sample, *, complete: bool) -> None:
        self._number += 1
        self._open = _Open(self._number, moving, first, np.zeros(self.joints), complete)
        self._announced = False

    def _announce(self, sample: Sample) -> None:
        if not self._announced:
            self._announced = True
            peak = np.max([self._current.peak, *(np.abs(s.speed) for s in self._uncounted)], axis=0)
            self._out.append(self._interval(sample.seen, sample.last_pose, peak, closed=False))

    def _close(self, last: Sample) -> None:
        while self._uncounted and self._uncounted[0].time < last.time:
            self._count(self._uncounted.popleft())
        self._out.append(self._interval(last.time, last.pose, self._current.peak, closed=True))

    def _count(self, sample: Sample) -> None:
        np.maximum(self._current.peak, np.abs(sample.speed), out=self._current.peak)

    def _interval(self, end: int, pose: Float, peak: Float, *, closed: bool) -> Interval:
        current = self._current
        return Interval(
            source=self.source,
            number=current.number,
            start=current.first.time,
            end=end,
            moving=tuple(j + 1 for j in range(self.joints) if current.moving >> j & 1),
            displacement=tuple((pose - current.first.pose).tolist()),
            pose=tuple(current.first.pose.tolist()),
            peak_speed=tuple(peak.tolist()),
            closed=closed,
            complete=current.complete,
        )


def _travel(a: Sample, b: Sample) -> float:
    """Largest displacement of any joint between two samples, rad."""
    return float(np.abs(b.pose - a.pose).max())


def _after(moving: int, changes: Iterable[Change]) -> int:
    """The set of moving joints after some changes."""
    for change in changes:
        bit = 1 << change.joint
        moving = moving | bit if change.started else moving & ~bit
    return moving


def _boundary(old: int, new: int, group: Iterable[Change]) -> Sample:
    """Sample at which one set of moving joints replaced another, from changes too close together to separate.

    Motion begins when the first joint starts and ends when the last one stops; between two moving sets the
    boundary is the start of the first newly moving joint.
    """
    last = {c.joint: c.sample for c in group}
    started = [s for joint, s in last.items() if (new & ~old) >> joint & 1]
    stopped = [s for joint, s in last.items() if (old & ~new) >> joint & 1]
    return min(started, key=lambda s: s.time) if started else max(stopped, key=lambda s: s.time)
