"""Expected positions and power in each interval of a healthy cycle, by time from the cycle's start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.criteria import Codes
from cellwatt_plugins.faults.reference import Variant
from cellwatt_plugins.robot.samples import interpolated


@dataclass(frozen=True, slots=True)
class Readings:
    """Samples of a cycle or an interval: ``t`` (n,) s from the cycle's start, encoder positions ``q`` (n, joints) rad,
    supply ``power`` (n,) W."""

    t: Float
    q: Float
    power: Float


@dataclass(frozen=True, slots=True)
class ExpectedInterval:
    """Expected samples (``readings``) of interval ``number`` and its ``moving`` joints, both numbered from 1."""

    number: int
    moving: tuple[int, ...]
    readings: Readings

    @property
    def start(self) -> float:
        """First time, s from the start of the cycle."""
        return float(self.readings.t[0])

    @property
    def end(self) -> float:
        """Last time, s from the start of the cycle."""
        return float(self.readings.t[-1])


def from_variant(variant: Variant) -> tuple[ExpectedInterval, ...]:
    """Expected intervals of a learned variant, in sequence with their rests."""
    out, start = [], -variant.intervals[0].rest
    for number, interval in enumerate(variant.intervals, start=1):
        start += interval.rest
        t = np.arange(0.0, interval.duration, interval.power.step)
        q = np.tile(np.asarray(interval.pose), (len(t), 1))
        for joint, pattern in interval.position.items():
            q[:, joint - 1] = pattern.at(t)
        readings = Readings(np.asarray(start + t, dtype=np.float64), q, interval.power.at(t))
        out.append(ExpectedInterval(number, interval.moving, readings))
        start += interval.duration
    return tuple(out)


def resampled(readings: Readings, t: Float) -> Readings:
    """Interpolate samples at times t (n,) s; constant beyond both ends."""
    return Readings(t, *(interpolated(t, readings.t, values) for values in (readings.q, readings.power)))


def fault_table(expected: Sequence[ExpectedInterval]) -> Codes:
    """Fault table (intervals, joints) like tables I and II for a task without known faults: 1 where a joint moves.

    The signs in tables I and II only number the joints (odd 1, even -1); the sign of a residual's code means that power
    rises or falls.
    """
    joints = expected[0].readings.q.shape[1]
    return np.array([[int(j in interval.moving) for j in range(1, joints + 1)] for interval in expected], np.int8)
