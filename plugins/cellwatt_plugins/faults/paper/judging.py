"""A cycle against its healthy reference as in Sabry et al.: criteria (16), both rules, codes (20), and the isolation.

Time is compared with time, interval by interval, with fixed tolerances: a cycle that runs at another speed is another
cycle. That is the paper's method with its limits, and the measure for what goes beyond it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cellwatt_plugins.faults.criteria import Codes, Tolerance, longest, ternary
from cellwatt_plugins.faults.isolate import TIE, agreement
from cellwatt_plugins.faults.paper.codes import FRAMES, Residual, of_energy, of_samples
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings, resampled
from cellwatt_plugins.faults.paper.network import FaultNetwork

Kind = Literal["joint", "encoder", "joint_and_encoder"]
Isolation = Callable[[Codes], tuple[int, ...]]
"""Codes (intervals,) of a cycle → the joint (from 1) that explains them, then those that do so as well; or none."""

REACH = 0.1
"""An interval may begin so much, s, before or after its time: rests are never quite the same …"""
SHIFTS = 20
"""… tried in so many steps to each side."""


@dataclass(frozen=True, slots=True)
class IntervalVerdict:
    """Verdict on one interval.

    ``code`` is equation (20), ``power_left`` whether power left (16). ``off`` holds the moving joints whose encoder
    left (16), ``still`` those of them that did not move at all. ``watts`` is the largest
    residual of power, with its sign, ``limit`` its tolerance there, ``off_by`` the largest residual of each joint,
    rad.
    """

    interval: ExpectedInterval
    code: int
    power_left: bool
    off: tuple[int, ...]
    still: tuple[int, ...]
    watts: float
    limit: float
    off_by: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class NamedFault:
    """A ``joint`` (from 1) that is faulty, the intervals that say so, the largest residual of power in them, W,
    and joints that explain them as well."""

    joint: int
    kind: Kind
    intervals: tuple[int, ...]
    watts: float
    alternatives: tuple[int, ...] = ()


def judge_interval(
    expected: ExpectedInterval, readings: Readings, tolerance: Tolerance, residual: Residual = "samples"
) -> IntervalVerdict:
    """One interval of a cycle; ``readings`` hold its time. ``residual`` is what its code is about."""
    reference = expected.readings
    seen = _aligned(expected, readings)
    power = seen.power - reference.power
    limit = tolerance.watts(reference.power)
    position = seen.q - reference.q
    off = [j for j in expected.moving if longest(ternary(position[:, j - 1], tolerance.position)) >= FRAMES]
    still = [j for j in off if np.ptp(seen.q[:, j - 1]) < tolerance.position]
    worst = int(np.argmax(np.abs(power)))
    by_samples = of_samples(reference, seen, tolerance)
    return IntervalVerdict(
        interval=expected,
        code=by_samples if residual == "samples" else of_energy(reference, seen, tolerance),
        power_left=by_samples != 0,
        off=tuple(off),
        still=tuple(still),
        watts=float(power[worst]),
        limit=float(limit[worst]),
        off_by=tuple(np.abs(position).max(axis=0).tolist()),
    )


def _aligned(expected: ExpectedInterval, readings: Readings) -> Readings:
    """The readings at the interval's times, shifted so that the better half of its moving joints fits best."""
    reference = expected.readings
    joints = np.asarray(expected.moving) - 1
    half = (len(joints) + 1) // 2

    def misfit(shift: float) -> float:
        seen = resampled(readings, reference.t + shift)
        off = np.abs(seen.q[:, joints] - reference.q[:, joints]).mean(axis=0)
        return float(np.sort(off)[:half].sum())

    shifts = np.linspace(-REACH, REACH, 2 * SHIFTS + 1).tolist()
    return resampled(readings, reference.t + min(sorted(shifts, key=abs), key=misfit))


def by_encoders(verdicts: Sequence[IntervalVerdict]) -> tuple[NamedFault, ...]:
    """The two rules under (16), for each joint whose encoder left its path.

    Power inside: the encoder. Power outside: the joint; the encoder too, unless it says what power says, that the
    joint stands still ("healthy but merely reflects the joint failure").
    """
    out = []
    for joint in sorted({j for verdict in verdicts for j in verdict.off}):
        mine = [verdict for verdict in verdicts if joint in verdict.off]
        watts = max((verdict.watts for verdict in mine), key=abs)
        reflects = all(joint in verdict.still for verdict in mine)
        kind: Kind = "joint" if reflects else "joint_and_encoder"
        if not any(verdict.power_left for verdict in mine):
            kind = "encoder"
        out.append(NamedFault(joint, kind, tuple(verdict.interval.number for verdict in mine), watts))
    return tuple(out)


def by_codes(verdicts: Sequence[IntervalVerdict], isolate: Isolation) -> tuple[NamedFault, ...]:
    """The joint that the codes (20) of all intervals of a cycle speak for, where every encoder keeps its path."""
    codes = np.array([verdict.code for verdict in verdicts], dtype=np.int8)
    joints = isolate(codes) if codes.any() else ()
    if not joints:
        return ()
    outside = [verdict for verdict in verdicts if verdict.code]
    watts = max((verdict.watts for verdict in outside), key=abs)
    return (NamedFault(joints[0], "joint", tuple(v.interval.number for v in outside), watts, joints[1:]),)


def codes_of(
    expected: Sequence[ExpectedInterval], cycle: Readings, tolerance: Tolerance, residual: Residual = "samples"
) -> Codes:
    """Codes (20) of a cycle, (intervals,): with a known fault in the arm they are its column of a fault table."""
    return np.array([judge_interval(interval, cycle, tolerance, residual).code for interval in expected], np.int8)


def by_agreement(table: Codes, *, signed: bool = False) -> Isolation:
    """Isolation by direct comparison with the columns of a fault table, without a network.

    ``signed`` where the table was learnt from faults, so that a rise of power is not a fall.
    """

    def isolate(codes: Codes) -> tuple[int, ...]:
        scores = agreement(codes, table, signed=signed)
        if scores.max() == 0:
            return ()
        order = np.argsort(-scores, kind="stable")
        return tuple((order[scores[order] >= scores.max() - TIE] + 1).tolist())

    return isolate


def by_network_or_agreement(network: FaultNetwork) -> Isolation:
    """Isolation by a trained network; where it says "free" of codes that are not, its table is compared.

    Power has left (16) then, so that something is wrong: a network that saw a few columns cannot say that nothing is.
    """
    signed, unsigned = (by_agreement(network.table, signed=each) for each in (network.signed, False))
    return lambda codes: network.joints(codes) or signed(codes) or unsigned(codes)
