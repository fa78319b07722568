"""The law of position servos: the torque of a drive for its command and the motion of its joint.

    torque = pull · command - stiffness · position - damping · velocity, within the drive's limits

A command holds until the next one. A row of the log has the command of the row's beginning, so a series of commands is
half a row late against the positions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.mjcf import compiled, library
from cellwatt_plugins.robot.motion import Moved
from cellwatt_plugins.robot.servo.filtered import held
from cellwatt_plugins.travel import LEVER

WITHIN = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of a row at which the law is evaluated."""


@dataclass(frozen=True)
class Servo:
    """Position servos of n joints, (n,) each, at the joint side."""

    pull: Float
    """Nm per unit of the command."""
    stiffness: Float
    """Nm/rad."""
    damping: Float
    """Nm s/rad."""
    low: Float
    """Limits, Nm."""
    high: Float
    delay: Float
    """s after which its commands act."""
    lever: Float
    """Travel that counts as 1 rad: 1 rad of a hinge, ``LEVER`` m of a slide."""


@dataclass(frozen=True)
class Drive:
    """The servos along a run: N samples, n joints."""

    servo: Servo
    command: Float
    """(N, n), as it acts at the times of the motion."""
    moved: Moved
    """The motion from the encoders."""
    turnovers: Float
    """(N, n, k): change of the velocity's sign if friction reversed within a lower speed, or within a higher one."""
    step: float
    """s between samples."""
    logged_command: Float
    """(N, n), the logged commands: each holds until the next one."""
    late: float = 0.0
    """s by which commands act later, approximately; the law reaches its limits later by the same time."""

    @cached_property
    def error(self) -> Float:
        """(N, n) rad from the joints' positions to their commanded positions."""
        return np.asarray(self.servo.pull / self.servo.stiffness * self.command - self.moved.position)

    @cached_property
    def commanded_velocity(self) -> Float:
        """(N, n) rad/s: velocity of the commanded position."""
        return np.asarray(np.gradient(self.servo.pull / self.servo.stiffness * self.command, self.step, axis=0))

    @cached_property
    def torque(self) -> Float:
        """Torque (N, n) Nm of the law; its limits are applied to the commands of ``late`` s before."""
        limits = enumerate(zip(self.servo.low, self.servo.high, strict=True))
        off = np.stack([self.beyond(joint, low, high) for joint, (low, high) in limits], axis=1)
        return np.asarray(self.asked(self.command) - off)

    @cached_property
    def taken(self) -> Float:
        """Torque (N, n) Nm that the limits take at the beginning of a row, and never more after it.

        The command is new then; the joint follows it within the row, faster than the filtered motion shows.
        """
        asked = self.asked(earlier(self.logged_command, self.late + self.servo.delay, self.step))
        return np.asarray(asked - np.clip(asked, self.servo.low, self.servo.high))

    def beyond(self, joint: int, low: float, high: float) -> Float:
        """Torque (N,) Nm by which a joint's law exceeds limits."""
        servo = self.servo

        def excess(command: Float, position: Float, velocity: Float) -> Float:
            asked = servo.pull[joint] * command - servo.stiffness[joint] * position - servo.damping[joint] * velocity
            return np.asarray(asked - np.clip(asked, low, high))

        return self.over_rows(joint, excess)

    def over_rows(self, joint: int, law: Callable[[Float, Float, Float], Float]) -> Float:
        """Means (N,) over rows of a ``law`` of command, position and velocity (N,), at the rows' times.

        A command holds while the joint moves: the mean of a nonlinear law is not the law of the mean command.
        """
        rows, late = np.arange(len(self.logged_command)), (self.late + self.servo.delay[joint]) / self.step
        position, velocity = self.moved.position[:, joint], self.moved.velocity[:, joint]
        ways = np.append(np.diff(position), 0.0), np.append(np.diff(velocity), 0.0)
        out = np.zeros(len(rows))
        for part in WITHIN:
            command = self.logged_command[np.maximum(np.floor(rows + part - late).astype(np.intp), 0), joint]
            out += law(command, position + part * ways[0], velocity + part * ways[1])
        return held(out[:, None] / len(WITHIN))[:, 0]

    def asked(self, command: Float) -> Float:
        """Torque (N, n) Nm of the law for a ``command`` (N, n), before its limits."""
        servo, moved = self.servo, self.moved
        return np.asarray(servo.pull * command - servo.stiffness * moved.position - servo.damping * moved.velocity)


def earlier(values: Float, late: float | Float, step: float) -> Float:
    """Values (N, n), every ``step`` s, from ``late`` s, or (n,), before; the first row also stands for times before
    it."""
    rows, each = np.arange(len(values)), np.broadcast_to(late, values.shape[1])
    return np.column_stack([np.interp(rows - ago / step, rows, one) for ago, one in zip(each, values.T, strict=True)])


def servo_of(path: Path, joints: Sequence[str]) -> Servo | None:
    """The position servos of ``joints`` in an MJCF, from the base; None if a joint has no servo of its own.

    Raises ``ConfigError`` where the file cannot be read.
    """
    model = compiled(path)
    rows = [row for name in joints if (row := _one(path, model, name)) is not None]
    return Servo(*np.array(rows).T) if len(rows) == len(joints) else None


def _one(path: Path, model: Any, name: str) -> tuple[float, ...] | None:
    """The numbers of a joint's servo, in the order of ``Servo``."""
    joint = model.joint(name).id
    at = actuator_of(model, joint)
    affine = library(path).mjtBias.mjBIAS_AFFINE
    if at < 0 or model.actuator_biastype[at] != affine or not model.actuator_biasprm[at, 1] < 0:
        return None
    gear, bias = float(model.actuator_gear[at, 0]), model.actuator_biasprm[at]
    low, high = -np.inf, np.inf
    if model.actuator_forcelimited[at]:
        low, high = sorted((gear * model.actuator_forcerange[at]).tolist())
    if model.jnt_actfrclimited[joint]:
        low, high = max(low, model.jnt_actfrcrange[joint, 0]), min(high, model.jnt_actfrcrange[joint, 1])
    pull = gear * float(model.actuator_gainprm[at, 0])
    delay = float(model.actuator_delay[at]) if hasattr(model, "actuator_delay") else 0.0
    lever = LEVER if model.jnt_type[joint] == library(path).mjtJoint.mjJNT_SLIDE else 1.0
    return pull, -(gear**2) * float(bias[1]), -(gear**2) * float(bias[2]), low, high, delay, lever


def actuator_of(model: Any, joint: int) -> int:
    """The one actuator that acts on a joint alone; -1 if there are none or several."""
    acting = [i for i in range(model.nu) if model.actuator_trntype[i] == 0 and model.actuator_trnid[i, 0] == joint]
    return acting[0] if len(acting) == 1 else -1
