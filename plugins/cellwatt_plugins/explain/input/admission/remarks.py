"""Remarks on the input: not errors, but to be known before reading the findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt.report.numbers import number
from cellwatt_plugins.explain.input.admission.motion import AT_REST, travel
from cellwatt_plugins.explain.input.factors import MOVES, joints_text, usable
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import LEVELS, unread_remarks
from cellwatt_plugins.robot import Arm, RobotDescription
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST
from cellwatt_plugins.robot.stretches import stretches

CLIPPED = 0.01
"""Share of samples at exactly the largest or smallest value above which a torque looks clipped."""
ROW = 3
"""Consecutive samples at the extreme that noise does not produce."""
OFTEN = 2
"""Average number of times that each value occurs where fewer than ``LEVELS`` show the steps between them."""
ROUGH = 1.0
"""Uncertainty of the torque that a motion needs, over its rms, above which it carries little information."""
SHORT = 0.15
"""Total duration, s, up to which no remark is given."""
PERIOD = 4
"""Samples per period of the fastest motion that is resolved."""


def remarks(runs: Sequence[Run], arm: Arm) -> list[str]:
    """Remarks on the runs, one sentence each."""
    widest = np.max([travel(run) for run in runs], axis=0)
    lever = arm.body.levers
    notes = [f"{run.name}: the arm stands still" for run in runs if np.all(travel(run) < AT_REST * lever)]
    if (still := np.flatnonzero(widest < MOVES * lever)).size:
        notes.append(f"{joints_text((still + 1).tolist())} never moved: friction and inertia there cannot be found")
    if all(run.power is None for run in runs):
        notes.append("no power recorded: effects that show only in the supply cannot be tested")
    notes += unread_remarks(runs)
    notes += _slow(runs)
    for run in runs:
        # Without any torque the drives were off, which has a note of its own.
        if (filled := run.filled & ~np.isnan(run.torque).all(axis=1)).any():
            share = number(100 * float(np.mean(filled)), 2)
            notes.append(f"{run.name}: {share} % of the samples were filled in and do not count")
        notes += _cut_off(run, arm.description)
        notes += _coarse(run, arm)
    return notes


def rough(states: Sequence[States]) -> Iterator[str]:
    """One sentence for each run with stretches without smooth motion, whose torque carries little information."""
    for run in states:
        doubt = (run.own_inertia + run.robot.column("rotor_inertia")) * run.moved.acceleration_spread
        moves = np.ptp(run.q, axis=0) > MOVES * run.arm.body.levers
        far = np.any(moves & (doubt > ROUGH * np.sqrt(np.mean(np.square(run.nominal), axis=0))), axis=1)
        inner = [(a, b) for a, b in stretches(far) if a > 0 and b < len(far)] if run.moved.planned else []
        seconds = sum(b - a for a, b in inner) * run.step
        if seconds > SHORT:
            yield (
                f"{run.name}: {number(seconds, 2)} s follow no smooth motion (a stop, a shock) and have little "
                f"weight, first at {run.time[inner[0][0]]:.2f} s"
            )


def _slow(runs: Sequence[Run]) -> Iterator[str]:
    slowest = max(runs, key=lambda run: run.step)
    rate = 1 / slowest.step
    if rate < FAST:
        how = "recorded at" if slowest.averaged == 1 else "averaged, as the recordings are long, to"
        yield (
            f"{how} {rate:.2g} Hz, which follows motions of up to {rate / PERIOD:.2g} Hz: elasticity, backlash, "
            "delays, contacts and friction that builds up after a reversal cannot be found"
        )


def _cut_off(run: Run, robot: RobotDescription) -> Iterator[str]:
    for i in range(run.joints):
        torque = _read(run, i)
        if len(np.unique(torque)) < LEVELS:
            continue
        for extreme in (torque.max(), torque.min()):
            at = torque == extreme
            if at.mean() > CLIPPED and any(end - start >= ROW for start, end in stretches(at)):
                yield (
                    f"{run.name}: the torque of joint {i + 1} stays at its extreme of {extreme:.4g} "
                    f"{robot.unit(i, 'Nm')} in {100 * at.mean():.1f} % of the samples: it seems to be cut off there"
                )


def _coarse(run: Run, arm: Arm) -> Iterator[str]:
    moves = travel(run) > MOVES * arm.body.levers
    for i in np.flatnonzero(moves).tolist():
        torque = _read(run, i)
        levels = np.unique(torque)
        if 1 < len(levels) < min(LEVELS, len(torque) / OFTEN):
            yield (
                f"{run.name}: the torque of joint {i + 1} comes in steps of {np.min(np.diff(levels)):.3g} "
                f"{arm.description.unit(i, 'Nm')}: smaller effects cannot be found"
            )


def _read(run: Run, joint: int) -> Float:
    """Torque (R,) Nm of a joint in the samples that were read."""
    torque = run.torque[usable(run), joint]
    return np.asarray(torque[np.isfinite(torque)])
