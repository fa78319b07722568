"""Compares one interval with its healthy reference, point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.faults.criteria import Codes, Tolerance, outside, ternary
from cellwatt_plugins.faults.reference import LEAD, TAIL, Pattern, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

Bools = NDArray[np.bool_]

BASE = (-0.1, 0.0)
"""Span before the onset, s, whose median power deviation is the base level: a joint at rest shows no fault."""
SPREADS = 3.0
"""The tolerance is at least this many standard deviations of healthy power."""
SHIFT = 0.15
"""Largest correction of an onset that encoder noise or a jolt has made too early or late, s …"""
FITS = 0.25
"""… made if positions then agree to within this share of the position tolerance."""
SPEED_SHARE, SPEED_FLOOR = 0.03, 0.01
ACCELERATION_SHARE, ACCELERATION_FLOOR = 0.06, 0.15
"""The motion follows the reference while it agrees within these shares of the peaks plus floors (rad/s, rad/s²)."""
STEP_SIDE = 4
STEP_SHARE = 0.7
STEP_CALM = 0.5
STEP_FLAT = 0.25
"""A step of the base level: the medians of ``STEP_SIDE`` frames on each side differ, ``STEP_SHARE`` of it between
neighbouring frames, while the reference changes by less than ``STEP_CALM`` of it and the residual on either side by
less than ``STEP_FLAT`` of it."""
WINDOW = 0.04
"""Time on each side over which speed and acceleration are computed, s."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of n frames, from ``LEAD`` s before the onset.

    ``t`` (n,) s from the onset; ``position`` (n, joints) rad and ``power`` (n,) W: distance from the band that the
    reference and onset jitter explain, NaN where missing; ``limit`` (n,) W: epsilon_p; ``reference`` (n,) W;
    ``follows`` (n,): true while the motion is that of the reference, so that power can be judged.
    """

    t: Float
    position: Float
    power: Float
    limit: Float
    reference: Float
    follows: Bools

    @property
    def power_codes(self) -> Codes:
        """Equation (20) on power at each frame of the interval; 0 before the onset and where power is missing."""
        return np.where(self.t >= 0, ternary(np.nan_to_num(self.power), self.limit), 0).astype(np.int8)

    def position_codes(self, limit: float) -> Codes:
        """Equation (20) on each joint's position (n, joints); 0 before the onset."""
        return np.where((self.t >= 0)[:, None], ternary(np.nan_to_num(self.position), limit), 0).astype(np.int8)

    @property
    def power_known(self) -> float:
        """Share of the interval's frames with a measured power."""
        inside = self.t >= 0
        return float(np.mean(~np.isnan(self.power[inside]))) if inside.any() else 0.0


def compare(reference: ReferenceInterval, onset: int, trace: Trace, tolerance: Tolerance, reach: float) -> Comparison:
    """Compare ``trace`` with ``reference``, aligned at ``onset`` (ns); ``reach`` is the allowed onset jitter, s."""
    longest = reference.duration + TAIL
    wide = trace.between(onset - round((LEAD + SHIFT) * 1e9), onset + round((longest + SHIFT) * 1e9))
    onset += round(_shift(reference, wide.since(onset), wide.position, tolerance, reach) * 1e9)
    near = wide.between(onset - round(LEAD * 1e9), onset + round(longest * 1e9))
    t = near.since(onset)
    expected = reference.power.at(t)
    limit = np.maximum(tolerance.watts(expected), SPREADS * np.interp(t, reference.power.time, reference.power.spread))
    low, high = reference.power.envelope(t, reach)
    base = base_level(t, near.power - expected)
    calm = (np.abs(t) > reach) & (t < reference.duration - reach)
    level = base + steps(near.power - expected - base, limit, high - low, calm)
    position = near.position - np.asarray(reference.pose)
    for joint, pattern in reference.position.items():
        position[:, joint - 1] = outside(near.position[:, joint - 1], *pattern.envelope(t, reach))
    return Comparison(
        t=t,
        position=position,
        power=outside(near.power - level, low, high),
        limit=limit,
        reference=expected,
        follows=_follows(reference, t, near.position, position, tolerance, reach),
    )


def _shift(reference: ReferenceInterval, t: Float, position: Float, tolerance: Tolerance, reach: float) -> float:
    """Correction of the onset, s (positive: later), if with it the moving joints follow their paths; 0 otherwise."""
    before = (t >= -LEAD) & (t < BASE[0] / 2)
    since = t >= -SHIFT
    if not before.any():
        return 0.0
    moved = {}
    for joint, pattern in reference.position.items():
        offset = np.median(position[before, joint - 1] - pattern.at(t[before]))
        moved[joint] = position[since, joint - 1] - offset

    def misfit(shift: float) -> float:
        errors = [np.abs(way - reference.position[joint].at(t[since] - shift)) for joint, way in moved.items()]
        return float(np.mean(errors))

    enough = FITS * tolerance.position
    if not misfit(0.0) > enough:
        return 0.0
    step = max(reach / 2, reference.power.step)
    shifts = step * np.arange(-int(SHIFT / step), int(SHIFT / step) + 1)
    best = min(shifts.tolist(), key=misfit)
    return best if misfit(best) <= enough else 0.0


def base_level(t: Float, residual: Float) -> float:
    """Median of a power residual (n,) W over the span ``BASE`` before the onset; 0 if it is missing there."""
    around = residual[(t >= BASE[0]) & (t <= BASE[1])]
    known = around[~np.isnan(around)]
    return float(np.median(known)) if len(known) else 0.0


def steps(residual: Float, limit: Float, swing: Float, calm: Bools) -> Float:
    """Cumulative steps (n,) W of a power residual (n,) W that no motion caused.

    Such a step is a load switched or attached between two frames, while the reference hardly changes (``swing``
    (n,) W: its change nearby); the motion is judged by the changes of power after it. ``calm`` (n,) is false near
    the start and end of a motion, where friction causes steps too.
    """
    level = np.zeros(len(residual))
    k = STEP_SIDE
    while k < len(residual) - STEP_SIDE:
        jump = float(residual[k + 1] - residual[k - 1])
        if calm[k] and abs(jump) > STEP_SHARE * limit[k] and swing[k] < STEP_CALM * abs(jump):
            before, after = residual[k - STEP_SIDE : k], residual[k + 1 : k + 1 + STEP_SIDE]
            rise = float(np.median(after) - np.median(before))
            flat = max(np.ptp(before), np.ptp(after)) < STEP_FLAT * abs(rise)
            if flat and abs(rise) > limit[k] and STEP_SHARE < jump / rise < 1 / STEP_SHARE:
                level[k + 1 :] += rise
                k += STEP_SIDE
        k += 1
    return level


def _follows(
    reference: ReferenceInterval, t: Float, measured: Float, error: Float, tolerance: Tolerance, reach: float
) -> Bools:
    """True (n,) while the moving joints have followed the reference; false for the last frames, not yet known."""
    follows = np.zeros(len(t), dtype=bool)
    n = max(1, round(WINDOW / float(np.median(np.diff(t))))) if len(t) > 1 else 1
    if len(t) <= 2 * n:
        return follows
    inner = slice(n, -n)
    half = (t[2 * n :] - t[: -2 * n]) / 2
    same = np.ones(len(half), dtype=bool)
    for joint, pattern in reference.position.items():
        q = measured[:, joint - 1]
        speed = (q[2 * n :] - q[: -2 * n]) / (2 * half)
        acceleration = (q[2 * n :] - 2 * q[inner] + q[: -2 * n]) / half**2
        speeds, accelerations = _motion(pattern, t[inner], half, reach)
        same &= _near(speed, speeds, SPEED_SHARE, SPEED_FLOOR)
        same &= _near(acceleration, accelerations, ACCELERATION_SHARE, ACCELERATION_FLOOR)
        same &= np.abs(error[inner, joint - 1]) <= tolerance.position
    follows[inner] = np.logical_and.accumulate(same | (t[inner] < 0))
    return follows


def _near(value: Float, around: Float, share: float, floor: float) -> Bools:
    """True for values (n,) within the band of ``around`` (shifts, n), widened by a share of its peak and a floor."""
    low, high = around.min(axis=0), around.max(axis=0)
    return np.asarray(np.abs(outside(value, low, high)) <= share * float(np.abs(around).max()) + floor)


def _motion(pattern: Pattern, t: Float, half: Float, reach: float) -> tuple[Float, Float]:
    """Speed and acceleration (shifts, n) of a position pattern within ``reach`` s of each time."""
    near = t + np.linspace(-reach, reach, 5)[:, None]
    before, here, after = pattern.at(near - half), pattern.at(near), pattern.at(near + half)
    return (after - before) / (2 * half), (after - 2 * here + before) / half**2


def power_agrees(
    reference: ReferenceInterval, trace: Trace, start: int, end: int, tolerance: Tolerance, frames: int
) -> bool:
    """True if the power between ``start`` and ``end`` (ns) contains that of an interval without measured motion."""
    window = trace.between(start - round(LEAD * 1e9), end)
    for onset in window.time[(window.time >= start) & (window.time + round(reference.duration * 1e9) <= end)].tolist():
        t = window.since(onset)
        inside = (t >= 0) & (t <= reference.duration)
        expected = reference.power.at(t)
        residual = window.power - expected
        codes = ternary((residual - base_level(t, residual))[inside], tolerance.watts(expected[inside]))
        if not np.isnan(residual[inside]).any() and np.count_nonzero(codes) < frames:
            return True
    return False
