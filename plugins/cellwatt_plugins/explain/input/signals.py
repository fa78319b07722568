"""Quantities of one file, joint by joint, on an even time grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Bool, Float, rows_of
from cellwatt.errors import RecordingError
from cellwatt.tables import Table, listed, read_table, usual
from cellwatt.tables.likely import hint
from cellwatt_plugins.explain.input.grid import EVEN, Kind, even
from cellwatt_plugins.explain.simulators.mujoco import Actuators
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.meter.held import held, onto
from cellwatt_plugins.robot.motion import slope
from cellwatt_plugins.robot.samples import EFFORTS, Even, in_torques
from cellwatt_plugins.robot.simulated import joints_in
from cellwatt_plugins.robot.stretches import stretches

LOSSY = ("torque", "torque_ratio", "current")
"""Quantities that may lack joints or samples of joints; missing values are NaN."""
BY_ACTUATOR = ("actuator_force", "control")
"""Quantities of a simulator's actuators, whose number and order may differ from those of the joints."""
OPTIONAL = ("velocity", "acceleration", *LOSSY, "temperature", "command", *BY_ACTUATOR)
"""Quantities that count as not recorded if all their columns are empty."""
WHOLE: Mapping[str, Kind] = {"temperature": "slow", "velocity": "spare", "acceleration": "spare"}
"""Quantities that are not used if a column lacks many values: two of them can be derived."""
NEEDED = ("position", "target_position", "target_velocity", "target_acceleration")
POWER = "power"
LEAST_MEANS = 8
"""Smallest number of means of a recording: if it is too short, ``check_length`` refuses it for its length."""
PAUSE, SHORT = 10.0, 2.0
"""s without a sample at which a recording is divided, and s of its shortest part that is used."""
FOLLOWS = 0.3
"""Standard deviation of control minus position, as a share of the position's, up to which controls are positions."""


LEAP = 10.0
"""rad/s (m/s) that no joint has in the row after a rest."""


@dataclass(frozen=True)
class Signals(Even):
    """Content of one file: N samples, evenly spaced, (N, n) by quantity; ``BY_ACTUATOR``: one column each, or n."""

    place: str
    """Name of the file in messages."""
    time: Float
    """(N,) s."""
    joints: dict[str, Float]
    power: Float | None
    """(N,) W."""
    gaps: Bool
    """(N,) true where values were filled in."""
    exact_times: bool
    """False if the times were estimated from the positions."""
    notes: tuple[str, ...]
    columns: tuple[str, ...]
    """Names of all columns except the time, for messages."""
    hint: str = ""
    """Likely meaning of the columns with unknown names, for messages."""
    averaged: int = 1
    """Number of recorded samples of which each sample is the mean."""

    def needed(self, *quantities: str) -> Float:
        """The first of these quantities that the file has, (N, n). Raises ``RecordingError`` if it has none of them."""
        for quantity in quantities:
            if quantity in self.joints:
                return self.joints[quantity]
        names = " or ".join(_family(quantity) for quantity in quantities)
        raise RecordingError(
            f"{self.place}: no {quantities[0]}: expected {names}; there are: {listed(self.columns)}{self.hint}"
        )

    def with_controls(self, drives: Actuators | None) -> Signals:
        """Convert forces and controls of a simulator's ``drives`` to torques, controls of other drives to commands.

        Without drives, controls are commands at joints whose positions follow them, otherwise torques. Torques,
        currents and commands that the file already has are not replaced.
        """
        found = {quantity: values for quantity, values in self.joints.items() if quantity not in BY_ACTUATOR}
        if "actuator_force" in self.joints:
            gears = 1.0 if drives is None else drives.gears
            found.setdefault("torque", self._at_joints("actuator_force", drives) * gears)
        if "control" in self.joints:
            control = self._at_joints("control", drives)
            gains = np.where(self._followed(control), np.nan, 1.0) if drives is None else drives.gains
            motors = np.isfinite(gains)
            if motors.any() and "current" not in found:
                found.setdefault("torque", control * gains)
            if not motors.all():
                found.setdefault("command", np.where(motors, np.nan, control))
        return replace(self, joints=found)

    def _at_joints(self, quantity: str, drives: Actuators | None) -> Float:
        """Values (N, n) of the actuators of the joints, NaN where a joint has none. Raises ``RecordingError``."""
        values, joints = self.joints[quantity], self.needed("position", "target_position").shape[1]
        if drives is not None and values.shape[1] == drives.count:
            return np.where(drives.numbers < 0, np.nan, values[:, drives.numbers])
        if values.shape[1] != joints:
            there = "" if drives is None else f" and {drives.count} actuators"
            columns = f"{values.shape[1]} columns {usual(quantity, 0)}, …"
            raise RecordingError(f"{self.place}: {columns}, but the robot has {joints} joints{there}")
        return values

    def _followed(self, control: Float) -> Bool:
        """True (n,) where the positions follow the controls."""
        position = self.needed("position", "target_position")
        apart = np.std(control - position, axis=0)
        return np.asarray(apart < FOLLOWS * np.std(position, axis=0), np.bool_)

    def parts(self) -> list[Signals]:
        """The parts between pauses, at least one."""
        paused = np.zeros(len(self.time), np.bool_)
        for first, end in stretches(self.gaps):
            paused[first:end] = (end - first) * self.step > PAUSE
        found = [slice(*ends) for ends in stretches(~paused) if (ends[1] - ends[0]) * self.step > SHORT]
        if not paused.any() or not found:
            return [self]
        note = f"{Path(self.place).name}: its pauses are left out, and its {len(found)} parts are used"
        return [
            replace(
                rows_of(self, part),
                joints={quantity: values[part] for quantity, values in self.joints.items()},
                notes=() if i else (*self.notes, note),
            )
            for i, part in enumerate(found)
        ]

    def slower(self, rate: float) -> Signals:
        """Average consecutive samples to a rate of ``rate`` Hz or less; a mean is a gap if one of its samples is."""
        count = min(int(np.ceil(1 / (self.step * rate) - EVEN)), len(self.time) // LEAST_MEANS)
        if count < 2:
            return self
        rows = len(self.time) // count

        def mean(values: Float) -> Float:
            return np.asarray(values[: rows * count].reshape(rows, count, *values.shape[1:]).mean(axis=1))

        return replace(
            self,
            time=mean(self.time),
            joints={quantity: mean(values) for quantity, values in self.joints.items()},
            power=None if self.power is None else self._slower_power(mean),
            gaps=np.any(self.gaps[: rows * count].reshape(rows, count), axis=1),
            averaged=count,
        )

    def _slower_power(self, mean: Callable[[Float], Float]) -> Float:
        """Mean power (M,) W; for a slow meter, its value at the mean time of the samples instead."""
        assert self.power is not None
        if held([(self.time, self.power)]) is None:
            return mean(self.power)
        return onto(mean(self.time), self.time, self.power)

    def derivatives(self, position: str, velocity: str, acceleration: str) -> tuple[Float, Float]:
        """Velocity and acceleration (N, n), computed by differentiation if the file lacks them."""
        speed = self.joints.get(velocity)
        if speed is None:
            speed = slope(self.joints[position], self.step)
        gain = self.joints.get(acceleration)
        if gain is None:
            gain = slope(speed, self.step)
        return speed, gain


def read_signals(path: Path, robot: RobotDescription) -> Signals:
    """Read a file. Raises ``RecordingError``, which reports what is wrong with the file."""
    table = read_table(path, robot.names)
    time = table.time
    names, joints = _joints(table, robot)
    power = table.whole("supply.power")
    if power is not None and not np.isfinite(power).any():
        power = None
    positions = next((q for q in ("position", "target_position") if q in joints), None)
    if positions is None:
        wanted = f"{_family('position')} or {_family('target_position')}"
        raise RecordingError(f"{path}: no position: expected {wanted}; {table.there()}{hint(table)}")
    columns = {name: column for q in joints for name, column in zip(names[q], joints[q].T, strict=True) if name}
    columns |= {} if power is None else {POWER: power}
    # Rows without the position of any joint are removed, which turns them into holes in time.
    placeholders = _placeholders(time, [joints[q] for q in (positions, "velocity", *LOSSY) if q in joints])
    recorded = np.isfinite(joints[positions]).any(axis=1) & ~placeholders
    columns = {name: column[recorded] for name, column in columns.items()}
    of: dict[str, Kind] = {positions: "position", **dict.fromkeys(LOSSY, "lossy"), **WHOLE}
    kinds: dict[str, Kind] = {POWER: "power", **{n: kind for q, kind in of.items() for n in names.get(q, ())}}
    grid = even(path.name, time[recorded], columns, kinds, table.row_numbers[recorded])
    silent = np.full(len(grid.time), np.nan)
    found = {q: np.column_stack([grid.columns.get(name, silent) for name in names[q]]) for q in joints}
    found = {q: values for q, values in found.items() if q not in WHOLE or np.isfinite(values).all()}
    return Signals(
        place=str(path),
        time=grid.time,
        joints=found,
        power=grid.columns.get(POWER),
        gaps=grid.gaps,
        exact_times=grid.exact_times,
        notes=(*_turned(path.name, table, names), *_placeholder_note(path.name, time[placeholders]), *grid.notes),
        columns=table.names,
        hint="" if {*LOSSY, *BY_ACTUATOR, "command"} & joints.keys() else hint(table),
    )


def _joints(table: Table, robot: RobotDescription) -> tuple[dict[str, tuple[str, ...]], dict[str, Float]]:
    """Names of the columns and values (N, n) of each quantity that the file holds, for all joints of the robot.

    The name of a column that is absent from a ``LOSSY`` quantity is "".
    """
    names: dict[str, tuple[str, ...]] = {}
    joints, expected = {}, len(robot.joints)
    count = len(table.joint_names("position"))
    has_gripper = count > expected and _all_of(robot, count)
    for quantity in (*NEEDED, *OPTIONAL):
        lossy = quantity in LOSSY
        own = table.some_joint_names(quantity, expected, "position") if lossy else table.joint_names(quantity)
        found = [np.full(len(table), np.nan) if (one := table.channel(name)) is None else one for name in own]
        if not found or (quantity in OPTIONAL and not np.isfinite(found).any()):
            continue
        if quantity in BY_ACTUATOR:
            names[quantity], joints[quantity] = own, np.column_stack(found)
            continue
        if has_gripper:
            own, found = own[:expected], found[:expected]
        names[quantity], joints[quantity] = own, np.column_stack(found)
        if len(own) != expected:
            first, *rest = own
            many = f"{first} … {rest[-1]}" if rest else first
            raise RecordingError(
                f"{table.path}: {len(own)} joints in the columns {many}, but the robot's description has "
                f"{expected} ({listed(robot.names)})"
            )
        for name, joint in zip(own, robot.joints, strict=True):
            if table.along(name) not in (None, joint.kind == "prismatic"):
                raise RecordingError(
                    f"{table.path}: the unit of column {name} is not one of joint {joint.name}, which is {joint.kind}"
                )
    return names, joints


def _all_of(robot: RobotDescription, count: int) -> bool:
    """True if the robot's file has ``count`` joints, of which the robot's are the first; others are a gripper's."""
    every = joints_in(robot.urdf)
    return len(every) == count and tuple(every[: len(robot.joints)]) == robot.names


def _turned(place: str, table: Table, names: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
    """One note if angles modulo a turn were unwrapped."""
    found = {name: count for q in NEEDED for name in names.get(q, ()) if (count := table.wraps(name))}
    if found:
        times = ", ".join(f"{name} ({count} times)" for name, count in found.items())
        yield f"{place}: angles modulo a turn, unwrapped by whole turns: {times}"


def _placeholders(time: Float, state: Sequence[Float]) -> Bool:
    """True (N,) at rows that only repeat a row, if positions leap at either end: nothing was read there.

    ``state``: positions and what else was measured, (N, n) each. Programs log the last values, or 0, until they receive
    others.
    """
    way = np.abs(np.diff(state[0], axis=0)) - LEAP * np.abs(np.diff(time))[:, None]
    leaps = np.append(False, np.any(way > 0, axis=1))
    out = np.zeros(len(time), np.bool_)
    every = np.nan_to_num(np.column_stack(state))
    for first, end in stretches(np.all(every[1:] == every[:-1], axis=1)):
        if leaps[first] or leaps[min(end + 1, len(time) - 1)]:
            out[first + (first > 0 and not leaps[first]) : end + 1] = True
    return out


def _placeholder_note(place: str, when: Float) -> Iterator[str]:
    if len(when):
        yield (
            f"{place}: {len(when)} rows repeat one row up to a leap of the positions, first at t = {when[0]:.3f} s: "
            "nothing was read there. They are left out"
        )


def motor_torque(signals: Signals, robot: RobotDescription) -> Float:
    """Torque (N, n) Nm as recorded, or of ``EFFORTS``; NaN where a joint's value is missing.

    All values are NaN if only commands were recorded. Raises ``RecordingError`` if efforts and command are all missing,
    and ``ConfigError`` if a number of the description that converts them is unknown.
    """
    quantity = next((quantity for quantity in EFFORTS if quantity in signals.joints), "torque")
    if quantity not in signals.joints and "command" in signals.joints:
        return np.full_like(signals.joints["command"], np.nan)
    return in_torques(signals.needed(quantity, "current"), quantity, robot, signals.place)


def _family(quantity: str) -> str:
    return f"{usual(quantity, 1)}, {usual(quantity, 2)}, …"
