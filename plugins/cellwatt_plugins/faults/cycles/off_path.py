"""Meanings of a joint off its path: a wrong encoder, or a joint that its drive does not move.

Only power tells: with a wrong encoder it is as in healthy cycles, without a drive the joint's share is missing, and
with the belt off the motor turns its own rotor and bearings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Motion, friction
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.load import Load, load_of, motor_alone, unsure_friction
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import without_jumps
from cellwatt_plugins.faults.cycles.samples import DOUBT, Samples
from cellwatt_plugins.robot.motion import rates

Cause = Literal["encoder", "drive_cut", "belt_off", "moved"]
"""``moved``: it did as its encoder shows, so this is another task."""

STOPPED: tuple[Cause, ...] = ("drive_cut", "belt_off")

STILL = 0.1
"""A joint that covers less than this share of its healthy range stands still."""
MODEL = 0.05
"""Share of the missing power by which the model may be wrong beyond its parameters."""
RUBBING, RUBBING_DOUBT = 0.5, 0.3
"""Share of a joint's friction that is on the motor's side of its belt."""
UNMODELLED = 0.5
"""Of what the fitted arm misses of healthy power, as of a part that it holds, a joint may have had so much of its share
(one sigma: between nothing and all)."""
MARGIN = 0.25
"""s beyond the times that are asked for in which a shown path is smoothed, too."""
LEAST_KNOWN = 1.5
"""W by which the model may miss what a joint takes, however little it is (one sigma)."""
OFFSET = math.radians(0.4)
"""rad by which an encoder that is merely shifted may be off its shift."""
TURNING_DOUBT = 0.5
"""Share of a rotor's power that may be seen of a motor without its belt."""


@dataclass(frozen=True)
class Interpretation:
    """``causes`` of each joint (0-based) off its path, the ``load`` of the arm as it then moves, ``residual`` (N,) W
    that is left to explain and ``doubt`` (N, k) W of it (one sigma each)."""

    causes: tuple[tuple[int, Cause], ...]
    load: Load
    residual: Float
    doubt: Float
    silent: tuple[int, ...] = ()
    """Joints (0-based) that their encoders show at rest: they stand still, or only their encoders are wrong."""

    @property
    def stopped(self) -> tuple[int, ...]:
        """Joints that stand still."""
        return tuple(joint for joint, cause in self.causes if cause in STOPPED)

    @property
    def foreign(self) -> bool:
        """True if it means that this is another task."""
        return any(cause == "moved" for _, cause in self.causes)


def readings(
    recording: Recording, match: Match, pattern: Pattern, arm: FittedArm, samples: Samples
) -> Iterator[Interpretation]:
    """Every combination of causes; and that all is well in another task, where a joint shows another way."""
    gone = pattern.time <= samples.tau[-1]
    options: list[list[tuple[int, Cause]]] = []
    silent: list[int] = []
    vague = [np.empty((len(samples.residual), 0))]
    elsewhere: bool = False
    for joint in match.odd:
        shown = np.interp(samples.time, recording.time, recording.position[:, joint])
        options.append([(joint, "encoder")])
        if np.ptp(shown) < STILL * np.ptp(pattern.position[gone, joint]):
            silent.append(joint)
            options[-1] += [(joint, "drive_cut"), (joint, "belt_off")]
            share = _load(recording, arm, samples, [(joint, "drive_cut")]).power - samples.healthy.power
            vague.append(LEAST_KNOWN * share[:, None] / max(float(np.abs(share).max()), 1e-9))
        else:
            elsewhere = elsewhere or _goes_elsewhere(recording, match, pattern, joint, float(samples.tau[-1]))
    for causes in product(*options):
        yield replace(_reading(recording, arm, samples, causes, np.column_stack(vague)), silent=tuple(silent))
    if elsewhere:
        yield _reading(recording, arm, samples, [(joint, "moved") for joint in match.odd], np.column_stack(vague))


def _reading(
    recording: Recording, arm: FittedArm, samples: Samples, causes: Sequence[tuple[int, Cause]], vague: Float
) -> Interpretation:
    """Residual once joints stand where they were at the cycle's start, or go where they show."""
    healthy = samples.healthy
    if all(cause == "encoder" for _, cause in causes):
        return Interpretation(tuple(causes), healthy, samples.residual, vague)
    load = _load(recording, arm, samples, causes)
    change = load.power - healthy.power
    doubt = [vague, DOUBT * (load.slope(arm.parameters) - healthy.slope(arm.parameters)) @ arm.deviations]
    drives = np.abs(healthy.drives)
    for joint, cause in causes:
        if cause in STOPPED:
            share = drives[:, joint] / np.maximum(drives.sum(axis=1), 1e-9)
            doubt.append((UNMODELLED * share * samples.unmodelled)[:, None])
            lever = healthy.lever[:, [joint]]
            doubt.append(lever * unsure_friction(healthy, joint, friction(arm.parameters, healthy.motion.qd)[:, joint]))
        if cause == "belt_off":
            rubbing, turning = motor_alone(arm.parameters, healthy.motion, joint)
            change = change + RUBBING * load.gain * rubbing
            doubt.append(load.gain[:, None] * np.column_stack([RUBBING_DOUBT * rubbing, TURNING_DOUBT * turning]))
    return Interpretation(tuple(causes), load, samples.residual - change, np.column_stack([*doubt, MODEL * change]))


def _load(recording: Recording, arm: FittedArm, samples: Samples, causes: Sequence[tuple[int, Cause]]) -> Load:
    """The load of the arm while joints stand or go as the causes say."""
    healthy = samples.healthy
    stopped = [joint for joint, cause in causes if cause in STOPPED]
    q, qd, qdd = healthy.motion.q.copy(), healthy.motion.qd.copy(), healthy.motion.qdd.copy()
    q[:, stopped], qd[:, stopped], qdd[:, stopped] = q[0, stopped], 0.0, 0.0
    for joint, cause in causes:
        if cause == "moved":
            q[:, joint], qd[:, joint], qdd[:, joint] = _shown(recording, joint, samples.time)
    return load_of(arm.body, arm.parameters, Motion(q, qd, qdd), dead=stopped)


def _goes_elsewhere(recording: Recording, match: Match, pattern: Pattern, joint: int, until: float) -> bool:
    """True if an encoder shows other ways between rests than the healthy ones: not if it is merely shifted."""
    edges = np.minimum([edge for move in pattern.moves if move[0] < until for edge in move], until)
    when = match.warp.to_recording(edges)
    rows = _rows(recording, when, 0)
    path = without_jumps(recording.position[rows][:, [joint]])[:, 0]
    off = np.interp(when, recording.time[rows], path) - pattern.position_at(edges)[:, joint]
    return bool(np.ptp(off) > OFFSET)


def _rows(recording: Recording, time: Float, margin: int) -> slice:
    """The samples from the first to the last of some times, and ``margin`` on either side."""
    first, last = np.searchsorted(recording.time, [time[0], time[-1]])
    return slice(max(0, int(first) - margin), int(last) + margin + 1)


def _shown(recording: Recording, joint: int, time: Float) -> tuple[Float, Float, Float]:
    """Angle, speed and acceleration of an encoder at times (N,) s."""
    rows = _rows(recording, time, round(MARGIN / recording.step))
    shown = rates(without_jumps(recording.position[rows][:, [joint]]), recording.step)
    angle, velocity, acceleration = (np.interp(time, recording.time[rows], rate[:, 0]) for rate in shown)
    return angle, velocity, acceleration
