"""Judges a cycle as in Sabry et al.: criteria (16), both rules, codes (20), and the isolation of the joint.

Intervals are compared with the reference at equal times, with fixed tolerances, so a cycle at another speed is another
cycle. This is the method of the paper with its limits; the project's own method is measured against it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.criteria import Codes, Tolerance, sustained, ternary
from cellwatt_plugins.faults.paper.codes import FRAMES, Residual, of_energy, of_samples
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings, resampled
from cellwatt_plugins.faults.paper.network import FaultNetwork

Kind = Literal["joint", "encoder", "joint_and_encoder"]
Isolation = Callable[[Codes], tuple[int, ...]]
"""Maps the codes (intervals,) of a cycle to the joint (1-based) that explains them, then its alternatives; or none."""

REACH = 0.1
"""Largest shift of an interval, s, before or after its expected time, as rests vary …"""
SHIFTS = 20
"""… and the number of steps tried on each side."""
TIE = 0.05
"""Joints whose agreement is lower than the best by at most this are alternatives."""


@dataclass(frozen=True, slots=True)
class IntervalVerdict:
    """Verdict on one interval.

    ``code``: equation (20); ``power_left``: power left tolerance (16); ``off``: moving joints whose encoder left (16);
    ``still``: those of them that did not move; ``watts``: largest power residual, signed, and ``limit``: its
    tolerance; ``off_by``: largest position residual of each joint, rad.
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
    """A faulty ``joint`` (1-based), the ``intervals`` that show the fault, their largest power residual ``watts``, and
    the ``alternatives``: joints that explain them equally well."""

    joint: int
    kind: Kind
    intervals: tuple[int, ...]
    watts: float
    alternatives: tuple[int, ...] = ()


def judge_interval(
    expected: ExpectedInterval, readings: Readings, tolerance: Tolerance, residual: Residual = "samples"
) -> IntervalVerdict:
    """Judge one interval of a cycle; ``readings`` include its time. ``residual`` is the quantity of its code."""
    reference = expected.readings
    seen = _aligned(expected, readings)
    power = seen.power - reference.power
    limit = tolerance.watts(reference.power)
    position = seen.q - reference.q
    off = [j for j in expected.moving if sustained(ternary(position[:, j - 1], tolerance.position), FRAMES)]
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
    """The samples at the interval's times, shifted so that the better half of its moving joints fits best."""
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
    """Apply the two rules under (16) to each joint whose encoder left its path.

    Power inside: the encoder is faulty. Power outside: the joint is, and its encoder too, unless the encoder shows
    that the joint stands still ("healthy but merely reflects the joint failure").
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
    """The joint that explains the codes (20) of all intervals of a cycle, if every encoder follows its path."""
    codes = np.array([verdict.code for verdict in verdicts], dtype=np.int8)
    joints = isolate(codes) if codes.any() else ()
    if not joints:
        return ()
    outside = [verdict for verdict in verdicts if verdict.code]
    watts = max((verdict.watts for verdict in outside), key=abs)
    return (NamedFault(joints[0], "joint", tuple(v.interval.number for v in outside), watts, joints[1:]),)


def codes_of(expected: Sequence[ExpectedInterval], cycle: Readings, tolerance: Tolerance) -> Codes:
    """Codes (20) of a cycle, (intervals,); those of a cycle with a known fault are the fault's column of the table."""
    return np.array([judge_interval(interval, cycle, tolerance).code for interval in expected], np.int8)


def agreement(codes: Codes, expected: Codes, *, signed: bool = False) -> Float:
    """Agreement (joints,) 0 … 1 of the codes (k,) of k intervals with each joint's column of ``expected`` (k, joints).

    ``expected`` is nonzero where a fault of the joint changes the power: 1 where the joint moves, or if ``signed``
    the code from a fault table.
    """
    hit = (codes[:, None] != 0) & (expected != 0)
    if signed:
        hit &= codes[:, None] == expected
    either = (codes[:, None] != 0) | (expected != 0)
    return np.asarray(hit.sum(axis=0) / np.maximum(either.sum(axis=0), 1), dtype=np.float64)


def by_agreement(table: Codes, *, signed: bool = False) -> Isolation:
    """Isolate by direct comparison with the columns of a fault table, without a network.

    ``signed``: the table was learned from faults, so codes must also agree in sign.
    """

    def isolate(codes: Codes) -> tuple[int, ...]:
        scores = agreement(codes, table, signed=signed)
        if scores.max() == 0:
            return ()
        order = np.argsort(-scores, kind="stable")
        return tuple((order[scores[order] >= scores.max() - TIE] + 1).tolist())

    return isolate


def by_network_or_agreement(network: FaultNetwork) -> Isolation:
    """Isolate by a trained network; if its output is "free" for nonzero codes, compare with its table.

    Nonzero codes mean that power left (16), so a fault is present; a network trained on few columns cannot exclude it.
    """
    signed, unsigned = (by_agreement(network.table, signed=each) for each in (network.signed, False))
    return lambda codes: network.joints(codes) or signed(codes) or unsigned(codes)
