"""Joint trajectories as functions of time: pieces that each start and end at rest, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from cellwatt_plugins.mismatch.experiments.limits import Limits
from cellwatt_plugins.mismatch.input.run import Motion

Float = NDArray[np.float64]
Point = tuple[Float, Float, Float]
"""Position, velocity and acceleration, (N, n) each."""


class Piece(Protocol):
    """A part of a trajectory."""

    @property
    def seconds(self) -> float:
        """Duration, s."""
        ...

    def at(self, time: Float) -> Point:
        """Motion of the arm at times (N,) s since the piece began."""
        ...


@dataclass(frozen=True)
class Profile:
    """A way from 0 to 1 or beyond: speed rises to ``top`` as a raised cosine over ``ramp`` s, stays, and falls."""

    top: float
    """1/s."""
    ramp: float
    """s."""
    cruise: float
    """s at top speed."""

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return 2 * self.ramp + self.cruise

    @property
    def way(self) -> float:
        """Length of the way, rad."""
        return self.top * (self.ramp + self.cruise)

    def at(self, time: Float) -> Point:
        """Way, its rate (1/s) and the rate's change (1/s²) at times (N,) s, (N, 1) each."""
        rise = np.clip(time, 0.0, self.ramp)
        fall = np.clip(self.seconds - time, 0.0, self.ramp)
        steady = np.clip(time - self.ramp, 0.0, self.cruise)
        angle = np.pi / self.ramp
        way = self._risen(rise) + self.top * steady + self.top * self.ramp / 2 - self._risen(fall)
        rate = self.top * (1 - np.cos(angle * np.minimum(rise, fall))) / 2
        change = self.top * angle / 2 * (np.sin(angle * rise) - np.sin(angle * fall))
        return way[:, None], rate[:, None], change[:, None]

    def _risen(self, time: Float) -> Float:
        return self.top * (time / 2 - self.ramp / (2 * np.pi) * np.sin(np.pi * time / self.ramp))


@dataclass(frozen=True, eq=False)
class Hold:
    """Rest in a pose (n,)."""

    pose: Float
    seconds: float

    def at(self, time: Float) -> Point:
        """Motion of the arm at times (N,) s."""
        still = np.zeros((len(time), len(self.pose)))
        return still + self.pose, still, still


@dataclass(frozen=True, eq=False)
class Move:
    """Straight way in joint space."""

    start: Float
    end: Float
    profile: Profile

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.profile.seconds

    def at(self, time: Float) -> Point:
        """Motion of the arm at times (N,) s."""
        way, rate, change = self.profile.at(time)
        go = self.end - self.start
        return self.start + way * go, rate * go, change * go


@dataclass(frozen=True, eq=False)
class Replay:
    """A recorded motion again: its clock runs as the profile says, from a start at rest to a stop."""

    spline: CubicSpline[np.float64]
    """Position over the motion's own time from 0 s."""
    profile: Profile

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.profile.seconds

    def at(self, time: Float) -> Point:
        """Motion of the arm at times (N,) s."""
        clock, rate, change = self.profile.at(time)
        position, velocity, acceleration = (self.spline(clock[:, 0], order) for order in range(3))
        return position, velocity * rate, acceleration * rate**2 + velocity * change


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Sines about a pose, all joints at once, faded in and out over ``fade`` s."""

    centre: Float
    """(n,) rad."""
    size: Float
    """(K, n) rad."""
    frequency: Float
    """(K,) Hz."""
    phase: Float
    """(K, n) rad."""
    seconds: float
    fade: float = 3.0

    def at(self, time: Float) -> Point:
        """Motion of the arm at times (N,) s."""
        turn = 2 * np.pi * self.frequency[:, None]
        angle = turn * time[:, None, None] + self.phase
        sines = np.sum(self.size * np.sin(angle), axis=1)
        first = np.sum(self.size * turn * np.cos(angle), axis=1)
        second = np.sum(-self.size * turn**2 * np.sin(angle), axis=1)
        share, rate, change = self._faded(time)
        position = self.centre + share * sines
        return position, rate * sines + share * first, change * sines + 2 * rate * first + share * second

    def _faded(self, time: Float) -> Point:
        """Share of the full size and its two derivatives, (N, 1) each; a quintic at each end."""
        edge = np.minimum(time, self.seconds - time)
        way = np.where(time < self.seconds / 2, 1.0, -1.0)
        x = np.clip(edge / self.fade, 0.0, 1.0)
        share = x**3 * (10 - 15 * x + 6 * x**2)
        rate = way * 30 * x**2 * (1 - x) ** 2 / self.fade
        change = 60 * x * (1 - x) * (1 - 2 * x) / self.fade**2
        return share[:, None], rate[:, None], change[:, None]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Pieces one after the other."""

    pieces: tuple[Piece, ...]

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return float(sum(piece.seconds for piece in self.pieces))

    def sampled(self, step: float) -> Motion:
        """The trajectory every ``step`` s; the last sample is at rest."""
        time = step * np.arange(int(np.ceil(self.seconds / step - 1e-9)) + 1, dtype=np.float64)
        ends = np.cumsum([piece.seconds for piece in self.pieces])
        which = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
        parts = []
        for i, piece in enumerate(self.pieces):
            since = np.minimum(time[which == i] - (ends[i] - piece.seconds), piece.seconds)
            parts.append(piece.at(since))
        position, velocity, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Motion(time, position, velocity, acceleration)


def move(start: Float, end: Float, limits: Limits, speed: float = np.inf) -> tuple[Piece, ...]:
    """From pose to pose within the limits, no joint faster than ``speed`` rad/s; () where there is no way to go."""
    go = np.abs(end - start)
    moving = go > 1e-9
    if not moving.any():
        return ()
    top = float(np.min(np.minimum(limits.cruise, speed)[moving] / go[moving]))
    # A raised cosine's greatest slope is π/2 times its mean.
    least = float(np.max(np.pi / 2 * go[moving] / limits.ramp[moving]))
    if top**2 * least >= 1:
        ramp = float(np.sqrt(least))
        return (Move(start, end, Profile(1 / ramp, ramp, 0.0)),)
    ramp = top * least
    return (Move(start, end, Profile(top, ramp, 1 / top - ramp)),)


def through(poses: Sequence[Float], limits: Limits, speed: float = np.inf, rest: float = 0.5) -> tuple[Piece, ...]:
    """From pose to pose with rests (s) in each but the first."""
    out: list[Piece] = []
    for start, end in pairwise(poses):
        out += [*move(start, end, limits, speed), Hold(end, rest)]
    return tuple(out)


def replay(motion: Motion, speed: float, ramp: float = 2.0) -> Replay:
    """A motion again at a ``speed`` relative to its own."""
    since = motion.time - motion.time[0]
    length = float(since[-1])
    return Replay(CubicSpline(since, motion.position), Profile(speed, ramp, length / speed - ramp))


def harmonics(limits: Limits, seconds: float, seed: int = 1) -> Harmonics:
    """Five harmonics of 20 s in every joint, as large as range, velocity and acceleration allow (Swevers 1997)."""
    random = np.random.default_rng(seed)
    frequency = np.array([1.0, 2.0, 3.0, 5.0, 8.0]) / 20.0
    joints = len(limits.home)
    size = (1 / np.array([1.0, 1.5, 2.0, 4.0, 8.0]))[:, None] * random.uniform(0.5, 1.0, (len(frequency), joints))
    centre = (limits.low + limits.high) / 2
    shape = Harmonics(np.zeros(joints), size, frequency, random.uniform(0, 2 * np.pi, size.shape), seconds)
    trial = shape.at(np.arange(0, min(seconds, 60.0), 0.01))
    room = ((limits.high - limits.low) / 2, limits.cruise, limits.ramp)
    share = np.min([free / np.max(np.abs(part), axis=0) for free, part in zip(room, trial, strict=True)], axis=0)
    return Harmonics(centre, 0.98 * share * size, frequency, shape.phase, seconds)
