"""Learns the fault table of a task from recorded or simulated cycles with a known fault."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt.frames import Frames
from cellwatt_plugins.faults.criteria import Codes, Tolerance
from cellwatt_plugins.faults.cycles.arm import Motion, supply_power, torque
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.paper.course import Course, Key
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings
from cellwatt_plugins.faults.paper.following import CyclesSeen
from cellwatt_plugins.faults.paper.judging import codes_of
from cellwatt_plugins.faults.trace import segmented
from cellwatt_plugins.robot.drive import drive_power
from cellwatt_plugins.robot.motion import differentiate

SPRINGS = (4.0, 8.0, 16.0)
"""Stiffness of the simulated springs, slack at the task's start: torque per radian in multiples of the joint's Coulomb
friction."""


def recorded(
    blocks: Sequence[Frames], courses: Sequence[Course], tolerance: Tolerance, arm: str | None, power: str
) -> dict[Key, list[Codes]]:
    """Codes (20), (intervals,), of every whole cycle in ``blocks``, by course."""
    found: defaultdict[Key, list[Codes]] = defaultdict(list)
    seen: CyclesSeen | None = None
    for block, intervals, _ in segmented(blocks, arm, power):
        seen = seen or CyclesSeen(courses, tolerance, block.position.shape[1])
        for cycle in seen.feed(block, intervals):
            if cycle.over:
                found[cycle.course.key].append(np.array([verdict.code for verdict in cycle.verdicts], np.int8))
    return dict(found)


def simulated(arm: FittedArm, course: Course, joint: int, tolerance: Tolerance) -> list[Codes]:
    """Codes (20) of a course's healthy cycle with each spring on a joint (1-based), by the arm's equations."""
    slack = float(course.intervals[0].readings.q[0, joint - 1])
    readings = [interval.readings for interval in course.intervals]
    motions = [Motion.of(arm.body, r.q, *differentiate(r.q, float(r.t[1] - r.t[0]))) for r in readings]
    regressors = [arm.body.regressor(m.q, m.qd, m.qdd) for m in motions]
    out = []
    for size in SPRINGS:
        stiffness = size * max(float(arm.parameters.coulomb[joint - 1]), 1e-3)
        parts = [
            codes_of([each], _with_spring(arm, each, motion, regressor, joint - 1, stiffness, slack), tolerance)
            for each, motion, regressor in zip(course.intervals, motions, regressors, strict=True)
        ]
        out.append(np.concatenate(parts))
    return out


def column_of(cycles: Sequence[Codes]) -> Codes:
    """Majority code (intervals,) over the cycles; 0 where no more than half of the cycles agree.

    Cycles without any code are ignored, as their fault is within the tolerance.
    """
    told = np.stack([codes for codes in cycles if codes.any()] or [np.zeros_like(cycles[0])])
    share = [np.mean(told == sign, axis=0) for sign in (1, -1)]
    return np.where(share[0] > 0.5, 1, np.where(share[1] > 0.5, -1, 0)).astype(np.int8)


def _with_spring(
    arm: FittedArm, expected: ExpectedInterval, motion: Motion, regressor: Float, j: int, stiffness: float, slack: float
) -> Readings:
    """An interval's healthy samples with a spring of ``stiffness`` Nm/rad on joint ``j`` (0-based), slack at ``slack``
    rad."""
    p, readings = arm.parameters, expected.readings
    forces = torque(p, regressor, motion)
    pulled = forces.copy()
    pulled[:, j] += stiffness * (readings.q[:, j] - slack)
    before, after = (supply_power(p, drive_power(p.copper, each, motion.qd)) for each in (forces, pulled))
    return Readings(readings.t, readings.q, readings.power + (after - before))
