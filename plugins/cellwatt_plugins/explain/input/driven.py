"""Torque of runs without measured torque, computed from commands and motion by the control law of the servos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import unread
from cellwatt_plugins.explain.simulators import Simulator
from cellwatt_plugins.robot.servo.filtered import filtered, held
from cellwatt_plugins.robot.servo.law import Drive, Servo, earlier, servo_of

DELAYS = (0.0, *(float(d) for d in np.geomspace(0.004, 0.12, 16)))
"""Delays of the commands, s, that are tried where the drives' limits are reached."""
BETTER = 0.5
"""Share of the error without a delay to which a delay must reduce it to be accepted."""


def driven(runs: Sequence[Run], simulator: Simulator) -> list[Run]:
    """Runs with commands and no torque get the torque of their servos; runs with torque stay unchanged."""
    servo = servo_of(simulator.path, simulator.joints)
    if servo is None:
        return list(runs)
    drives = [_drive(run, servo) for run in runs]
    late = _late([drive for drive in drives if drive is not None], simulator)
    out = []
    for run, drive in zip(runs, drives, strict=True):
        own = None if drive is None else replace(drive, late=late)
        out.append(run if own is None else replace(run, drive=own, torque=own.torque))
    return out


def _drive(run: Run, servo: Servo) -> Drive | None:
    """The servos along a run; None if it lacks commands or has torque."""
    if run.command is None or not np.isfinite(run.command).all() or not unread(run).all():
        return None
    return drive_of(servo, run.position, run.command, run.step)


def drive_of(servo: Servo, position: Float, command: Float, step: float) -> Drive:
    """The servos with a ``command`` and an encoder ``position`` (N, n) rad every ``step`` s."""
    acting = earlier(held(command), servo.delay, step)
    return Drive(servo, acting, *filtered(position, step, servo.lever), step, command)


def _late(drives: Sequence[Drive], simulator: Simulator) -> float:
    """Approximate delay of the commands, s, if drives seem to reach their limits; 0 if none is found."""
    limited = []
    for drive in drives:
        servo, demanded, moved = drive.servo, drive.asked(drive.command), drive.moved
        if np.any((demanded < servo.low) | (demanded > servo.high)):
            needed = simulator.torque(*moved.courses)
            limited.append((drive, needed, np.maximum(np.std(needed, axis=0), 1e-9)))

    def off(late: float) -> float:
        total = 0.0
        for drive, needed, size in limited:
            servo = drive.servo
            given = np.clip(drive.asked(earlier(drive.command, late, drive.step)), servo.low, servo.high)
            total += float(np.sum(np.median(np.abs(given - needed), axis=0) / size))
        return total

    errors = [off(late) for late in DELAYS]
    best = int(np.argmin(errors))
    return DELAYS[best] if errors[best] < BETTER * errors[0] else 0.0
