"""What a joint off its path may mean: a wrong encoder, or a joint that its drive does not move.

Only power tells: with a wrong encoder it is as in healthy cycles, without a drive the joint's share is missing, and
with the belt off the motor turns its own rotor and bearings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.identify import Arm
from cellwatt_plugins.faults.cycles.load import Load, load_of, motor_alone
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.samples import DOUBT, Samples

Float = NDArray[np.float64]

Cause = Literal["encoder", "drive_cut", "belt_off"]

STILL = 0.1
"""A joint that covers less than this share of its healthy range stands still."""
MODEL = 0.03
"""Share of the missing power by which the model may be wrong beyond its parameters."""
RUBBING, RUBBING_DOUBT = 0.5, 0.3
"""Share of a joint's friction that is on the motor's side of its belt."""
TURNING_DOUBT = 0.5
"""Share of a rotor's power that may be seen of a motor without its belt."""


@dataclass(frozen=True)
class Reading:
    """``causes`` of each joint (0-based) off its path, the ``load`` of the arm as it then moves, ``residual`` (N,) W
    that is left to explain and ``doubt`` (N, k) W of it (one sigma each)."""

    causes: tuple[tuple[int, Cause], ...]
    load: Load
    residual: Float
    doubt: Float

    @property
    def stopped(self) -> tuple[int, ...]:
        """Joints that stand still."""
        return tuple(joint for joint, cause in self.causes if cause != "encoder")


def readings(recording: Recording, match: Match, pattern: Pattern, arm: Arm, samples: Samples) -> Iterator[Reading]:
    """Every combination of causes."""
    gone = pattern.time <= samples.tau[-1]
    options: list[list[tuple[int, Cause]]] = []
    for joint in match.odd:
        shown = np.interp(samples.time, recording.time, recording.position[:, joint])
        options.append([(joint, "encoder")])
        if np.ptp(shown) < STILL * np.ptp(pattern.position[gone, joint]):
            options[-1] += [(joint, "drive_cut"), (joint, "belt_off")]
    for causes in product(*options):
        yield _reading(arm, samples, causes)


def _reading(arm: Arm, samples: Samples, causes: Sequence[tuple[int, Cause]]) -> Reading:
    """What is left of the residual once joints stand where they were at the cycle's start."""
    healthy = samples.healthy
    stopped = [joint for joint, cause in causes if cause != "encoder"]
    if not stopped:
        return Reading(tuple(causes), healthy, samples.residual, np.empty((len(samples.residual), 0)))
    q, qd, qdd = healthy.motion.q.copy(), healthy.motion.qd.copy(), healthy.motion.qdd.copy()
    q[:, stopped], qd[:, stopped], qdd[:, stopped] = q[0, stopped], 0.0, 0.0
    load = load_of(arm.body, arm.parameters, Motion(q, qd, qdd), dead=stopped)
    change = load.power - healthy.power
    doubt = [DOUBT * (load.slope(arm.parameters) - healthy.slope(arm.parameters)) @ arm.deviations]
    for joint, cause in causes:
        if cause == "belt_off":
            rubbing, turning = motor_alone(arm.parameters, healthy.motion, joint)
            change = change + RUBBING * load.gain * rubbing
            doubt.append(load.gain[:, None] * np.column_stack([RUBBING_DOUBT * rubbing, TURNING_DOUBT * turning]))
    return Reading(tuple(causes), load, samples.residual - change, np.column_stack([*doubt, MODEL * change]))
