"""One file's quantities, joint by joint, on an even time grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError, RecordingError
from cellwatt_plugins.mismatch.input.columns import PLAIN, Columns, Quantity, columns_of, listed
from cellwatt_plugins.mismatch.input.grid import EVEN, even
from cellwatt_plugins.mismatch.input.tables import Table, read_table
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.law import column
from cellwatt_plugins.robot.meter import held, onto
from cellwatt_plugins.robot.motion import OWN_BANDWIDTH, differentiate, smooth

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

SLOW: tuple[Quantity, ...] = ("temperature",)
"""Changes over minutes and is often logged more rarely than the rest."""
OPTIONAL: tuple[Quantity, ...] = ("velocity", "acceleration", "torque", "current", "temperature")
"""Counts as not recorded where all its columns are empty."""


@dataclass(frozen=True)
class Signals:
    """What one file holds: N samples, evenly spaced, (N, n) by quantity."""

    place: str
    """What messages call the file."""
    time: Float
    """(N,) s."""
    joints: dict[Quantity, Float]
    power: Float | None
    """(N,) W."""
    gaps: Bool
    """(N,) true where values were filled in."""
    notes: tuple[str, ...]
    columns: tuple[str, ...]
    """All the file has beside the time, for messages."""

    @property
    def step(self) -> float:
        """Seconds between samples."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def needed(self, *quantities: Quantity) -> Float:
        """The first of these quantities that is there. Raises ``RecordingError`` where none is."""
        for quantity in quantities:
            if quantity in self.joints:
                return self.joints[quantity]
        names = " or ".join(_family(quantity) for quantity in quantities)
        raise RecordingError(f"{self.place}: no {quantities[0]}: expected {names}; there are: {listed(self.columns)}")

    def slower(self, rate: float) -> Signals:
        """Means of as many samples as bring it to ``rate`` Hz or less; a mean is a gap where one of them is."""
        count = int(np.ceil(1 / (self.step * rate) - EVEN))
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
        )

    def _slower_power(self, mean: Callable[[Float], Float]) -> Float:
        """Means, but of a slow meter the value in the middle of them."""
        assert self.power is not None
        if held([(self.time, self.power)]) is None:
            return mean(self.power)
        return onto(mean(self.time), self.time, self.power)

    def derivatives(self, position: Quantity, velocity: Quantity, acceleration: Quantity) -> tuple[Float, Float]:
        """Velocity and acceleration; differentiated where the file lacks them."""
        speed = self.joints.get(velocity)
        if speed is None:
            speed = differentiate(smooth(self.joints[position], self.step, OWN_BANDWIDTH), self.step)[0]
        gain = self.joints.get(acceleration)
        if gain is None:
            gain = differentiate(smooth(speed, self.step, OWN_BANDWIDTH), self.step)[0]
        return speed, gain


def read_signals(path: Path, robot: RobotDescription) -> Signals:
    """Read a file. Raises ``RecordingError`` that says what is wrong with it."""
    table = read_table(path)
    columns = _with_content(table, columns_of(table.names(), table.place))
    _all_joints(table.place, columns, robot)
    values = {name: table.values(name) for name in columns.names()}
    positions = columns.joints.get("position", columns.joints.get("target_position", ()))
    if not positions:
        names = f"{_family('position')} or {_family('target_position')}"
        raise RecordingError(f"{table.place}: no position: expected {names}; there are: {listed(table.names())}")
    # Rows in which no joint was heard hold nothing: to leave them out makes them holes in time.
    heard = np.any([np.isfinite(values[name]) for name in positions], axis=0)
    grid = even(
        table.place,
        table.time[heard],
        {name: column[heard] for name, column in values.items()},
        slow=[name for quantity in SLOW for name in columns.joints.get(quantity, ())],
        positions=positions,
        power=columns.power,
    )
    return Signals(
        place=table.place,
        time=grid.time,
        joints={q: np.column_stack([grid.columns[name] for name in names]) for q, names in columns.joints.items()},
        power=None if columns.power is None else grid.columns[columns.power],
        gaps=grid.gaps,
        notes=grid.notes,
        columns=tuple(table.names()),
    )


def motor_torque(signals: Signals, robot: RobotDescription) -> Float:
    """Torque (N, n) Nm as recorded, or current times torque constant.

    Raises ``RecordingError`` where neither was recorded and ``ConfigError`` where a constant is not known.
    """
    if "torque" in signals.joints or "current" not in signals.joints:
        return signals.needed("torque", "current")
    constants = column(robot, "torque_constant")
    if unknown := [joint.name for joint in robot.joints if joint.torque_constant == 0]:
        raise ConfigError(
            f"{signals.place} has currents, no torques, and the torque_constant of {listed(unknown)} is 0: "
            "write it into the robot's description, in Nm/A at the joint side"
        )
    return signals.joints["current"] * constants


def _with_content(table: Table, columns: Columns) -> Columns:
    """Without the optional columns that are empty from top to bottom."""

    def empty(names: Sequence[str]) -> bool:
        return all(name not in table.text and not np.isfinite(table.columns[name]).any() for name in names)

    joints = {q: names for q, names in columns.joints.items() if not (q in OPTIONAL and empty(names))}
    power = None if columns.power is None or empty([columns.power]) else columns.power
    return Columns(joints, power)


def _all_joints(place: str, columns: Columns, robot: RobotDescription) -> None:
    expected = len(robot.joints)
    for names in columns.joints.values():
        if len(names) != expected:
            many = f"{names[0]} … {names[-1]}" if len(names) > 1 else names[0]
            raise RecordingError(
                f"{place}: {len(names)} joints in the columns {many}, but the robot's description has {expected} "
                f"({listed([joint.name for joint in robot.joints])})"
            )


def _family(quantity: Quantity) -> str:
    stem = PLAIN[quantity]
    return f"{stem}_1, {stem}_2, …"
