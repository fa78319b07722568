"""The torque of runs that have none: by the law of the servos, from what these were told and how the arm moved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.mismatch.input.unread import unread
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.servo.law import Drive, servo_of
from cellwatt_plugins.robot.servo.motion import filtered, held


def driven(run: Run, simulator: Path, robot: RobotDescription) -> Run:
    """The run with its servos' torque where it has commands alone; as it is where it has torque, or no such servos.

    Raises ``ConfigError`` where the simulator's file cannot be read.
    """
    if run.command is None or not np.isfinite(run.command).all() or not unread(run).all():
        return run
    servo = servo_of(simulator, [joint.name for joint in robot.joints])
    if servo is None:
        return run
    drive = Drive(servo, held(run.command), *filtered(run.position, run.step), run.step)
    return replace(run, drive=drive, torque=drive.torque)
