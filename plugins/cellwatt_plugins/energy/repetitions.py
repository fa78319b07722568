"""Finds start and end of each repetition of a closed path, from the encoders alone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import RobotTrace
from cellwatt_plugins.energy.rests import rests, signal_noise
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.samples import interpolated
from cellwatt_plugins.robot.stretches import stretches

POINTS = 200
"""Points of a repetition joined by straight lines for its path length, far enough apart to ignore encoder noise."""
SHORTEST_REST = 0.3
"""Shortest rest at the start pose between repetitions, s."""
MOST = 20
"""Most rests examined as start poses; they include corners, where a slow arm hardly moves."""
FEWEST = 4
"""Fewest samples of the beginning motion to which a law is fitted."""
REACHES = (100.0, 300.0, 1000.0)
"""Displacements up to which the motion is fitted, in encoder noise: the first that gives ``FEWEST`` samples."""
LAWS = (2, 3, 4)
"""Powers of time with which displacement grows: for limited acceleration, jerk or snap."""
AS_GOOD = 1.3
"""A law fits as well as the best if its misfit is within this factor of the best one's, or of the noise."""
SAME_LENGTH = 0.02
"""Largest relative difference of the duration of an uninterrupted repetition from the median."""


@dataclass(frozen=True)
class Repetition:
    """One repetition of the path, in s of the robot's clock; ``uncertainty`` of its duration, s."""

    start: float
    end: float
    uncertainty: float

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.end - self.start

    def path_speed(self, arm: Arm, motion: RobotTrace) -> float:
        """Mean Cartesian speed of the last joint's frame, from the encoders, mm/s."""
        q = interpolated(np.linspace(self.start, self.end, POINTS), motion.time, motion.position)
        positions = arm.forward(q)[:, -1, :3, 3]
        return 1000.0 * float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()) / self.seconds


def find_repetitions(motion: RobotTrace) -> tuple[list[Repetition], list[str]]:
    """Complete repetitions, and a sentence on each one excluded. Raises ``RecordingError`` if there is none.

    The start pose is the pose of longest total rest. A repetition that begins or ends elsewhere, or whose duration
    differs from the others', was interrupted and is excluded.
    """
    noise = signal_noise(motion.position)
    stays = _stays(motion, noise)
    if len(stays) < 2:
        raise RecordingError(
            f"{motion.place}: no complete repetition: the arm does not return to its start pose; "
            f"record from rest to rest, with {SHORTEST_REST} s or more at the start pose"
        )
    found = [_between(motion, before, after, noise) for before, after in pairwise(stays)]
    usual = float(np.median([repetition.seconds for repetition in found]))
    notes = []
    if stays[0][0] > 1 or stays[-1][1] < len(motion.time) - 1:
        notes.append("the recording begins or ends in motion; motion that is not from rest to rest is not used")
    uninterrupted = [r for r in found if abs(r.seconds - usual) <= SAME_LENGTH * usual + 2 * r.uncertainty]
    if not uninterrupted:
        lengths = ", ".join(f"{r.seconds:.2f}" for r in found)
        raise RecordingError(f"{motion.place}: repetitions took {lengths} s: which was interrupted? Record it again")
    notes += [
        f"the repetition at t = {r.start:.1f} s took {r.seconds:.2f} s instead of {usual:.2f} s: not used"
        for r in found
        if r not in uninterrupted
    ]
    return uninterrupted, notes


def _stays(motion: RobotTrace, noise: float) -> list[tuple[int, int]]:
    """First and last sample (exclusive) of each rest at the start pose, the pose of longest total rest."""
    longest = sorted(rests(motion), key=lambda rest: rest[0] - rest[1])[:MOST]
    least = round(SHORTEST_REST / motion.step)
    best: list[tuple[int, int]] = []
    for a, b in longest:
        pose = np.median(motion.position[a:b], axis=0)
        at = np.all(np.abs(motion.position - pose) < 6 * noise, axis=1)
        stays = [(c, d) for c, d in stretches(at | _gaps(at, 3)) if d - c >= least]
        best = max(best, stays, key=lambda spans: sum(b - a for a, b in spans))
    return best


def _gaps(flags: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """True for at most ``longest`` consecutive false samples between true ones, caused by noise."""
    out = np.zeros_like(flags)
    for a, b in stretches(~flags):
        out[a:b] = b - a <= longest and a > 0 and b < len(flags)
    return out


def _between(motion: RobotTrace, before: tuple[int, int], after: tuple[int, int], noise: float) -> Repetition:
    """The repetition between two rests; its end is found by the onset fit backwards in time."""
    middle = (before[1] + after[0]) // 2
    first = max(before[0], before[1] - round(1.0 / motion.step))
    last = min(after[1], after[0] + round(1.0 / motion.step))
    speed_noise = signal_noise(motion.velocity)
    there, back = slice(first, middle), slice(middle, last)
    start, e0 = onset(motion.time[there], motion.position[there], motion.velocity[there], (noise, speed_noise))
    backwards = (motion.position[back][::-1], -motion.velocity[back][::-1])
    end, e1 = onset(-motion.time[back][::-1], *backwards, (noise, speed_noise))
    return Repetition(start, -end, float(np.hypot(e0, e1)))


def onset(time: Float, position: Float, velocity: Float, noise: tuple[float, float]) -> tuple[float, float]:
    """Return the start of a motion from rest and its uncertainty, s.

    Displacement and velocity (N, n) along the first direction of motion are fitted by c (t − t₀)^m and its derivative;
    ``noise`` is their noise, rad and rad/s. The drive's law m is unknown and the first samples are below the noise, so
    the result is the mean over the laws that fit as well as the best.
    """
    rest = max(4, len(time) // 50)
    direction = _direction(position - np.median(position[:rest], axis=0), noise[0])
    s = (position - np.median(position[:rest], axis=0)) @ direction
    quiet = int(np.argmax(s > 5 * noise[0]))
    reached = [int(np.argmax(s > reach * noise[0])) for reach in REACHES]
    begun = next((i for i in reached if i - quiet >= FEWEST), max(reached[-1], quiet + 1))
    step = float(time[1] - time[0])
    window = slice(max(0, quiet - round(1.0 / step)), begun + 1)
    seen = (time[window], s[window], (velocity @ direction)[window])
    fits = [_fit(*seen, m, float(time[quiet]), noise[0] / noise[1]) for m in LAWS]
    best = max(min(misfit for misfit, _ in fits), noise[0] ** 2)
    good = [t0 for misfit, t0 in fits if misfit <= AS_GOOD * best]
    return float(np.mean(good)), max(float(np.ptp(good)) / 2, step / np.sqrt(12))


def _direction(moved: Float, noise: float) -> Float:
    """Unit vector of the first direction of motion."""
    size = np.linalg.norm(moved, axis=1)
    reach = int(np.argmax(size > min(300 * noise, 0.5 * float(size.max()))))
    return np.asarray(moved[reach] / max(float(size[reach]), 1e-12))


def _fit(time: Float, s: Float, v: Float, power: int, seen: float, weight: float) -> tuple[float, float]:
    """Smallest mean square misfit of c (t − t₀)^power to displacement and, weighted, to velocity; and its t₀."""
    step = float(time[1] - time[0])
    spread = max(float(time[-1]) - seen, step)
    starts = np.arange(seen - 1.5 * spread - 0.1, seen + step, min(step / 4, spread / 40))
    since = np.maximum(time[None, :] - starts[:, None], 0.0)
    first, second = (
        np.hstack([since**m, weight * m * since ** (m - 1)]) / max(float(time[-1] - starts[0]), step) ** m
        for m in (power, power + 1)
    )
    y = np.concatenate([s, weight * v])
    # A term of the next power models the later deviation from the law; both are solved by normal equations.
    a, b, d = (first * first).sum(axis=1), (first * second).sum(axis=1), (second * second).sum(axis=1)
    f, g = first @ y, second @ y
    determinant = np.maximum(a * d - b * b, 1e-12 * np.maximum(a * d, 1e-300))
    c, e = (d * f - b * g) / determinant, (a * g - b * f) / determinant
    misfit = np.mean((y[None, :] - c[:, None] * first - e[:, None] * second) ** 2, axis=1)
    misfit[c <= 0] = np.inf
    best = int(np.argmin(misfit))
    return float(misfit[best]), float(starts[best])
