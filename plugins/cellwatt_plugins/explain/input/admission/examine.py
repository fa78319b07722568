"""All checks of the input, in an order in which causes are found before their consequences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.progress import stage, steps
from cellwatt.scheduler import spread
from cellwatt_plugins.explain.input.admission.description import description_remarks
from cellwatt_plugins.explain.input.admission.motion import (
    check_jumps,
    check_limits,
    check_moving,
    check_stuck,
    check_velocity,
)
from cellwatt_plugins.explain.input.admission.pairing import check_pairing
from cellwatt_plugins.explain.input.admission.power import check_power, check_simulated_power
from cellwatt_plugins.explain.input.admission.remarks import remarks, rough
from cellwatt_plugins.explain.input.admission.torque import check_simulated, check_torque
from cellwatt_plugins.explain.input.baseline import Baseline, baseline
from cellwatt_plugins.explain.input.factors import usable
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import unread
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import Moved

SOONER = 0.95
"""Share to which friction that reverses early must reduce the squared changes of the residual."""
LEAST_SECONDS = 3.0
LEAST_SAMPLES = 75
"""Some hundred samples are some ten independent ones: the least for friction, gravity and inertia of six joints."""
SHORTEST = 1.0
"""Shortest run, s, that is used beside others."""
SLOW_SECONDS, SLOW_SAMPLES = 30.0, 60
"""Over so many seconds fewer samples suffice: at a few Hz each sample is independent."""


@dataclass(frozen=True)
class Admitted:
    """Runs that can be explained."""

    base: Baseline
    notes: tuple[str, ...]
    """Remarks on the input, to be read before the findings."""
    states: tuple[States, ...]
    """States of the simulated arm along each run."""


def admit(runs: Sequence[Run], arm: Arm) -> Admitted:
    """Check the runs, run by run. Raises ``RecordingError``, one line, at the first that cannot be used as it is."""
    if not runs:
        raise RecordingError("no recording given")
    check_length(runs)
    check_read(runs)
    check_moving(runs, arm)
    notes = [note for run in runs for note in run.notes]
    # Not spread over workers: sending a run takes as long as these checks.
    for run in steps(runs, "checking run"):
        notes += _check(run, arm)
    with stage("simulating the runs"):
        base = baseline(runs, arm)
    courses = spread(_followed, runs, "checking torques of runs", shared=base)
    base, states = _turning_over(runs, base, courses)
    notes += [*remarks(runs, arm), *rough(states), *description_remarks(runs, arm, base)]
    return Admitted(base, tuple(notes), tuple(states))


def _turning_over(
    runs: Sequence[Run], base: Baseline, courses: Sequence[tuple[Moved, Float | None, Float | None]]
) -> tuple[Baseline, list[States]]:
    """Let friction reverse before the velocity, as in the simulation, or with it, whichever fits the recordings better.

    Friction jumps when it reverses, so only the changes of torque from sample to sample are compared.
    """

    def made(recorded: Arm) -> tuple[float, Baseline, list[States]]:
        law = replace(base, recorded=recorded)
        states = [law.along(run, i, *course) for i, (run, course) in enumerate(zip(runs, courses, strict=True))]
        measured = [np.where(run.filled[:, None], np.nan, run.torque) for run in runs]
        pairs = zip(measured, states, strict=True)
        off = [np.diff((torque - s.nominal) / np.nanstd(torque), axis=0) for torque, s in pairs]
        return float(np.nansum(np.square(np.concatenate(off)))), law, states

    first = made(base.arm)
    if not base.arm.description.friction_lead:
        return first[1:]
    plain = made(base.arm.with_friction_lead(0.0))
    return first[1:] if first[0] < SOONER * plain[0] else plain[1:]


def check_run(run: Run, arm: Arm) -> Moved:
    """Check a single run and return its motion. Raises as ``admit``; ``arm`` is the simulation's."""
    check_length((run,))
    check_read((run,))
    check_moving((run,), arm)
    _check(run, arm)
    return _moved(run, arm)


def _check(run: Run, arm: Arm) -> list[str]:
    """Run the checks that do not need the smoothed motion; return remarks on the run."""
    check_stuck(run)
    notes = check_pairing(run, arm.description)
    check_limits(run, arm)
    check_velocity(run, arm.description)
    check_jumps(run, arm.description)
    check_simulated(run, arm)
    check_simulated_power(run)
    return notes


def _followed(run: Run, base: Baseline) -> tuple[Moved, Float | None, Float | None]:
    """The motion of a run, and its simulation's torque and power beyond the law; see ``Baseline.beyond``."""
    return _moved(run, base.arm), *base.beyond(run)


def _moved(run: Run, arm: Arm) -> Moved:
    """The motion of a run, after its torque and power are checked against it."""
    motion = moved(run)
    if run.drive is None:
        check_torque(run, motion, arm)
    check_power(run, motion)
    return motion


def check_read(runs: Sequence[Run]) -> None:
    """Raises ``RecordingError`` if a run has no torque of any joint, or only some runs use the law of their servos."""
    for run in runs:
        if not unread(run).all():
            continue
        if run.command is not None:
            raise RecordingError(
                f"{run.name}: commands and positions, but no torque: the control law of the drives must be "
                "known; give --simulation an MJCF whose joints have <position> actuators with their kp and kv"
            )
        raise RecordingError(
            f"{run.name}: no torque is related to the motion: every torque or current is empty, constant, or noise: "
            "were the drives read?"
        )
    driven = [run.name for run in runs if run.drive is not None]
    if 0 < len(driven) < len(runs):
        raise RecordingError(
            f"{driven[0]}: commands and positions, but no torque, which other recordings have: explain it separately"
        )


def check_length(runs: Sequence[Run]) -> None:
    """Raises ``RecordingError`` if a run, or all together, are too short to distinguish friction from noise."""
    used = [len(usable(run)) for run in runs]
    seconds = [count * run.step for count, run in zip(used, runs, strict=True)]
    for run, count, length in zip(runs, used, seconds, strict=True):
        if length < SHORTEST:
            raise RecordingError(f"{run.name}: {count} usable samples in {length:.2f} s are too few: leave it out")
    many = sum(seconds) >= LEAST_SECONDS and sum(used) >= LEAST_SAMPLES
    long = sum(seconds) >= SLOW_SECONDS and sum(used) >= SLOW_SAMPLES
    if not (many or long):
        place = runs[0].name if len(runs) == 1 else "the recordings"
        raise RecordingError(
            f"{place}: {sum(used)} usable samples in {sum(seconds):.2f} s are too few: at least {LEAST_SECONDS:.0f} s "
            f"and {LEAST_SAMPLES} samples of motion are needed, or {SLOW_SAMPLES} samples in {SLOW_SECONDS:.0f} s"
        )
