"""The torque of runs that have none: by the law of the servos, from what these were told and how the arm moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.mismatch.input.unread import unread
from cellwatt_plugins.mismatch.simulators import Simulator
from cellwatt_plugins.robot.servo.law import Drive, earlier, servo_of
from cellwatt_plugins.robot.servo.motion import filtered, held

DELAYS = (0.0, *(float(d) for d in np.geomspace(0.004, 0.12, 16)))
"""s that commands may act later, to see where the drives' limits are reached."""
BETTER = 0.5
"""Share of the error without a delay that one must leave to be believed."""


def driven(run: Run, simulator: Simulator) -> Run:
    """The run with its servos' torque where it has commands alone; as it is where it has torque, or no such servos."""
    if run.command is None or not np.isfinite(run.command).all() or not unread(run).all():
        return run
    servo = servo_of(simulator.path, simulator.joints)
    if servo is None:
        return run
    command = earlier(held(run.command), servo.delay, run.step)
    drive = Drive(servo, command, *filtered(run.position, run.step), run.step, run.command)
    drive = replace(drive, late=_late(drive, simulator))
    return replace(run, drive=drive, torque=drive.torque)


def _late(drive: Drive, simulator: Simulator) -> float:
    """s by which commands act later, about, where a drive seems to reach its limit."""
    servo, asked = drive.servo, drive.asked(drive.command)
    if not np.any((asked < servo.low) | (asked > servo.high)):
        return 0.0
    moved = drive.moved
    needed = simulator.torque(moved.position, moved.velocity, moved.acceleration)
    size = np.maximum(np.std(needed, axis=0), 1e-9)

    def off(late: float) -> float:
        given = np.clip(drive.asked(earlier(drive.command, late, drive.step)), servo.low, servo.high)
        return float(np.sum(np.median(np.abs(given - needed), axis=0) / size))

    errors = [off(late) for late in DELAYS]
    best = int(np.argmin(errors))
    return DELAYS[best] if errors[best] < BETTER * errors[0] else 0.0
