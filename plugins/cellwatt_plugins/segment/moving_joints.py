"""Moving joints, by hysteresis on speeds from encoder positions (the "data change detector" of Sabry et al., V.A)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float, Nanoseconds
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.segment.settings import SegmentSettings

WINDOW = 0.08
"""Time over which speed is computed from positions, s."""
CONFIRM = 3
"""Consecutive frames that must agree before a joint counts as started or stopped."""
START_SIGMAS = 8.0
STOP_SIGMAS = 4.0
"""Smallest start and stop limits, in standard deviations of the noise of the measured speed."""
CREEP = 0.2
"""Speed at which a joint is truly at rest, as a share of the stop speed: it sets the time of a start or stop."""
TRAIL = 1.0
"""Longest time between a start or stop and its confirmation, s."""


CHUNK = 64
"""Frames per noise estimate."""
MEMORY = 8
"""Number of recent estimates; the smallest is used, so that jerky motion is not taken for noise."""


class NoiseEstimate:
    """``sigma`` (joints,) rad is the standard deviation of the position noise; 0 until the first chunk is full.

    Fourth differences remove smooth motion, the median removes jerks.
    """

    def __init__(self, joints: int) -> None:
        self.filled, self.sigma = 0, np.zeros(joints)
        self._chunk: Float = np.empty((CHUNK, joints))
        self._estimates: deque[Float] = deque(maxlen=MEMORY)

    def add(self, positions: Float) -> None:
        """Add n positions (n, joints) rad, n at most ``CHUNK - filled``."""
        self._chunk[self.filled : self.filled + len(positions)] = positions
        self.filled += len(positions)
        if self.filled == CHUNK:
            self.filled = 0
            self._estimates.append(white_noise(self._chunk, 4))
            self.sigma = np.min(self._estimates, axis=0)


@dataclass(frozen=True, slots=True)
class Sample:
    """A frame with its speed: ``time`` ns, ``pose`` rad and ``speed`` rad/s per joint, ``fastest`` speed, rad/s.

    ``seen`` ns and ``last_pose`` rad are the time and pose of the newest frame used to compute the speed.
    """

    time: int
    pose: Float
    speed: Float
    fastest: float
    seen: int
    last_pose: Float


@dataclass(slots=True)
class Change:
    """A joint (0-based) started or stopped at ``sample``; ``fading`` while a stopping joint still creeps."""

    joint: int
    started: bool
    sample: Sample
    fading: bool = False


@dataclass(frozen=True, slots=True)
class Limits:
    """Speeds per joint, rad/s: above ``start`` it moves, below ``stop`` it stops, below ``creep`` it is truly at rest.

    ``band`` rad per joint: a joint is at its rest position while it is no further from it than this.
    """

    start: Float
    stop: Float
    creep: Float
    band: Float


class MovingJoints:
    """Tracks which joints of one arm move, over frames without a gap; ``step`` is the frame step in ns.

    ``moving`` holds a bit per joint, ``changes`` the starts and stops that the caller has not yet removed, in the
    order of confirmation, ``trail`` the newest samples. Speeds are differences over the window, because
    ``robot.motion`` smooths with future samples.
    """

    def __init__(self, joints: int, step: int, thresholds: SegmentSettings) -> None:
        self.joints = joints
        self.step = step
        self.thresholds = thresholds
        self.half = max(1, round(WINDOW * 1e9 / 2 / step))
        self.length = 2 * self.half + CONFIRM + math.ceil(TRAIL * 1e9 / step)
        self.noise = NoiseEstimate(joints)
        self._bits = 1 << np.arange(joints)
        self.reset()

    def reset(self) -> None:
        """Discard the motion so far; the next frame starts a new motion."""
        self.time: Nanoseconds = np.empty(0, np.int64)
        self.pose: Float = np.empty((0, self.joints))
        self.trail: deque[Sample] = deque(maxlen=self.length)
        self.moving = 0
        self.changes: list[Change] = []
        self._streak = [0] * self.joints

    @property
    def undecided(self) -> bool:
        """True if a joint is past a limit but its change is not yet confirmed."""
        return any(self._streak)

    def feed(self, time: Nanoseconds, pose: Float) -> Iterator[Sample]:
        """Process frames, ``time`` (n,) ns, ``pose`` (n, joints) rad; yield each sample once the state includes it."""
        while len(time):
            n = min(len(time), CHUNK - self.noise.filled)
            yield from self._piece(time[:n], pose[:n])
            self.noise.add(pose[:n])
            time, pose = time[n:], pose[n:]

    def _piece(self, time: Nanoseconds, pose: Float) -> Iterator[Sample]:
        """Process frames with one noise estimate; speeds are central differences."""
        reach = 2 * self.half
        when, where = np.concatenate([self.time, time]), np.concatenate([self.pose, pose])
        self.time, self.pose = when[-reach:], where[-reach:]
        if len(when) <= reach:
            return
        speed = (where[reach:] - where[:-reach]) / ((when[reach:] - when[:-reach]) * 1e-9)[:, None]
        size = np.abs(speed)
        fastest = size.max(axis=1)
        limits = self._limits()
        above, below = (size > limits.start) @ self._bits, (size < limits.stop) @ self._bits
        for k in range(len(speed)):
            middle = k + self.half
            last = k + reach
            sample = Sample(int(when[middle]), where[middle], speed[k], float(fastest[k]), int(when[last]), where[last])
            if not self.trail:
                self.moving = int(above[k])
            self.trail.append(sample)
            self._step(sample, int(above[k]), int(below[k]), limits)
            yield sample

    def _limits(self) -> Limits:
        """Speed limits, raised above the noise of a position difference over the window where needed."""
        window, sigma = 2 * self.half * self.step * 1e-9, self.noise.sigma
        noise = sigma * math.sqrt(2) / window
        creep = np.maximum(CREEP * self.thresholds.stop_speed, STOP_SIGMAS * noise)
        return Limits(
            start=np.maximum(self.thresholds.start_speed, START_SIGMAS * noise),
            stop=np.maximum(self.thresholds.stop_speed, STOP_SIGMAS * noise),
            creep=creep,
            band=np.maximum(creep * window / 2, STOP_SIGMAS * sigma),
        )

    def _step(self, sample: Sample, above: int, below: int, limits: Limits) -> None:
        """Apply the hysteresis to one sample."""
        for change in self.changes:
            _fade(change, sample, limits)
        candidates = (above & ~self.moving) | (below & self.moving)
        if not candidates and not self.undecided:
            return
        for joint in range(self.joints):
            self._streak[joint] = self._streak[joint] + 1 if candidates >> joint & 1 else 0
            if self._streak[joint] == CONFIRM:
                self._streak[joint] = 0
                self.changes.append(self._change(joint, limits))
                self.moving ^= 1 << joint

    def _change(self, joint: int, limits: Limits) -> Change:
        """Find the sample at which a joint's confirmed new state began."""
        trail = list(self.trail)
        creep, band = float(limits.creep[joint]), float(limits.band[joint])
        if self.moving >> joint & 1:
            fading = abs(trail[-1].speed[joint]) > creep
            change = Change(joint, False, trail[-1] if fading else _rest(trail, joint, band), fading)
        else:
            change = Change(joint, True, _onset(trail, joint, creep, band))
        for earlier in self.changes:
            if earlier.joint == joint:
                earlier.fading = False
                change.sample = max(change.sample, earlier.sample, key=lambda s: s.time)
        return change


def _onset(trail: list[Sample], joint: int, creep: float, band: float) -> Sample:
    """The last sample at which a joint that now moves was still at its rest position."""
    i = len(trail) - CONFIRM
    direction = math.copysign(1.0, trail[i].speed[joint])
    while i > 0 and direction * trail[i - 1].speed[joint] > creep:
        i -= 1
    rest = trail[i].pose[joint]
    while i + 1 < len(trail) and abs(trail[i + 1].pose[joint] - rest) <= band:
        i += 1
    return trail[i]


def _rest(trail: list[Sample], joint: int, band: float) -> Sample:
    """The first sample at which a joint that now rests had reached its rest position."""
    i = len(trail) - CONFIRM
    rest = trail[-1].pose[joint]
    while i > 0 and abs(trail[i - 1].pose[joint] - rest) <= band:
        i -= 1
    return trail[i]


def _fade(change: Change, sample: Sample, limits: Limits) -> None:
    """Move a stop to ``sample`` while the joint still creeps in its direction; end the fading once it does not."""
    joint = change.joint
    if change.fading:
        if change.sample.speed[joint] * sample.speed[joint] > 0 and abs(sample.speed[joint]) > limits.creep[joint]:
            change.sample = sample
        else:
            change.fading = False
