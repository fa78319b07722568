"""Course of a healthy cycle: positions and power in each interval, counted from the cycle's start."""

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
    """One cycle, or a part of it: times (n,) s from its start, encoders (n, joints) rad, supply power (n,) W."""

    t: Float
    q: Float
    power: Float


@dataclass(frozen=True, slots=True)
class ExpectedInterval:
    """``readings`` of interval ``number`` (from 1), in which the joints ``moving`` (from 1) move."""

    number: int
    moving: tuple[int, ...]
    readings: Readings

    @property
    def start(self) -> float:
        """s from the start of the cycle."""
        return float(self.readings.t[0])

    @property
    def end(self) -> float:
        """s from the start of the cycle."""
        return float(self.readings.t[-1])


def from_variant(variant: Variant) -> tuple[ExpectedInterval, ...]:
    """Intervals of a learned reference, which follow one another with their rests."""
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
    """Readings at other times t (n,) s, held at both ends."""
    return Readings(t, *(interpolated(t, readings.t, values) for values in (readings.q, readings.power)))


def fault_table(expected: Sequence[ExpectedInterval]) -> Codes:
    """A table (intervals, joints) like I and II for a task of which no fault is known: 1 where a joint moves.

    The signs of tables I and II only number the joints (odd 1, even -1); those of a residual say whether power rises.
    """
    joints = expected[0].readings.q.shape[1]
    return np.array([[int(j in interval.moving) for j in range(1, joints + 1)] for interval in expected], np.int8)
