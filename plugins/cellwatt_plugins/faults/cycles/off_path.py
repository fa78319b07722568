"""Interpretations of a joint off its path: a wrong encoder, or a joint that its drive does not move.

Only power distinguishes them: with a wrong encoder it is as in healthy cycles, with the drive cut off the joint's share
is missing, and with the belt off the motor drives only its own rotor and bearings.
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
"""``moved``: the joint moved as its encoder shows, so this is another task."""

STOPPED: tuple[Cause, ...] = ("drive_cut", "belt_off")

STILL = 0.1
"""A joint whose range is below this share of its healthy range stands still."""
MODEL = 0.05
"""Model error beyond its parameters, as a share of the missing power (one sigma)."""
RUBBING, RUBBING_DOUBT = 0.5, 0.3
"""Share of a joint's friction on the motor's side of its belt, and its uncertainty (one sigma)."""
UNMODELLED = 0.5
"""Uncertainty of a joint's part of the healthy power that the fitted arm does not model (as of a gripped part), as a
share of it (one sigma: between nothing and all)."""
MARGIN = 0.25
"""Time before and after the requested times that is included when an encoder's path is smoothed, s."""
LEAST_KNOWN = 1.5
"""Smallest model error of a joint's power, W (one sigma)."""
OFFSET = math.radians(0.4)
"""Largest variation of the offset of an encoder that is merely shifted, rad."""
TURNING_DOUBT = 0.5
"""Share of the rotor's power that a motor without its belt may take (one sigma)."""


@dataclass(frozen=True)
class Interpretation:
    """``causes`` of each joint (0-based) off its path, the ``load`` of the arm in the resulting motion, the unexplained
    ``residual`` (N,) W and its uncertainty ``doubt`` (N, k) W (one sigma per column)."""

    causes: tuple[tuple[int, Cause], ...]
    load: Load
    residual: Float
    doubt: Float
    silent: tuple[int, ...] = ()
    """Joints (0-based) whose encoders show rest: they stand still, or their encoders are wrong."""

    @property
    def stopped(self) -> tuple[int, ...]:
        """Joints that stand still."""
        return tuple(joint for joint, cause in self.causes if cause in STOPPED)

    @property
    def foreign(self) -> bool:
        """True if the interpretation is another task."""
        return any(cause == "moved" for _, cause in self.causes)


def interpretations(
    recording: Recording, match: Match, pattern: Pattern, arm: FittedArm, samples: Samples
) -> Iterator[Interpretation]:
    """Every combination of causes, and, if a joint moves along another path, a healthy cycle of another task."""
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
    doubt = np.column_stack(vague)
    for causes in product(*options):
        yield replace(_interpretation(recording, arm, samples, causes, doubt), silent=tuple(silent))
    if elsewhere:
        yield _interpretation(recording, arm, samples, [(joint, "moved") for joint in match.odd], doubt)


def _interpretation(
    recording: Recording, arm: FittedArm, samples: Samples, causes: Sequence[tuple[int, Cause]], vague: Float
) -> Interpretation:
    """The residual if stopped joints stay at their start position and moved joints follow their encoders."""
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
    """The load of the arm while joints stand still or move according to ``causes``."""
    healthy = samples.healthy
    stopped = [joint for joint, cause in causes if cause in STOPPED]
    q, qd, qdd = healthy.motion.q.copy(), healthy.motion.qd.copy(), healthy.motion.qdd.copy()
    q[:, stopped], qd[:, stopped], qdd[:, stopped] = q[0, stopped], 0.0, 0.0
    for joint, cause in causes:
        if cause == "moved":
            q[:, joint], qd[:, joint], qdd[:, joint] = arm.body.levers[joint] * _shown(recording, joint, samples.time)
    return load_of(arm.body, arm.parameters, Motion(q, qd, qdd), dead=stopped)


def _goes_elsewhere(recording: Recording, match: Match, pattern: Pattern, joint: int, until: float) -> bool:
    """True if an encoder shows other displacements between rests than in healthy cycles, not merely a shift."""
    edges = np.minimum([edge for move in pattern.moves if move[0] < until for edge in move], until)
    when = match.warp.to_recording(edges)
    rows = _rows(recording, when, 0)
    path = without_jumps(recording.position[rows][:, [joint]])[:, 0]
    off = np.interp(when, recording.time[rows], path) - pattern.position_at(edges)[:, joint]
    return bool(np.ptp(off) > OFFSET)


def _rows(recording: Recording, time: Float, margin: int) -> slice:
    """The samples from ``time[0]`` to ``time[-1]``, and ``margin`` samples on either side."""
    first, last = np.searchsorted(recording.time, [time[0], time[-1]])
    return slice(max(0, int(first) - margin), int(last) + margin + 1)


def _shown(recording: Recording, joint: int, time: Float) -> Float:
    """Angle, velocity and acceleration (3, N) of an encoder at times (N,) s."""
    rows = _rows(recording, time, round(MARGIN / recording.step))
    shown = rates(without_jumps(recording.position[rows][:, [joint]]), recording.step)
    return np.stack([np.interp(time, recording.time[rows], rate[:, 0]) for rate in shown])
