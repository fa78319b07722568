"""Selects the columns of an arm in the cell's frames, and checks them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.frames import Frames, Layout

if TYPE_CHECKING:
    from cellwatt_plugins.robot import RobotDescription

UNITS: dict[str, str] = {
    "position": "rad",
    "velocity": "rad/s",
    "torque": "Nm",
    "current": "A",
    "temperature": "degC",
    "target_position": "rad",
    "target_velocity": "rad/s",
    "target_acceleration": "rad/s^2",
}
"""Quantities of an arm that are used if present; the commanded motion sharpens the explanation."""
SUPPLY = "supply.power"


@dataclass(frozen=True)
class Judged:
    """Channel that is compared with the simulation: a joint's torque (1-based), or the supply's power."""

    name: str
    unit: str
    joint: int | None
    what: str
    """Name in messages."""


@dataclass(frozen=True)
class Intake:
    """The columns of one arm of n joints within the frames."""

    source: str
    joints: dict[str, tuple[int, ...]]
    """Columns (n,) by quantity: torque, current or command, and further quantities if the source has them."""
    power: int | None
    power_name: str
    gain: Float
    """(n,) Nm per unit of the measured quantity: 1, or the torque constants."""
    efforts: tuple[str, ...]
    """(n,) unit of each joint's torque: ``Nm``, or ``N`` for a prismatic joint."""

    @property
    def driven(self) -> bool:
        """True if no torque is measured, so that it is computed from the commands by the servos' law."""
        return "command" in self.joints

    @property
    def measured(self) -> str:
        """Quantity from which torque is computed."""
        return "current" if "current" in self.joints else "torque"

    @cached_property
    def places(self) -> dict[str, slice]:
        """Columns of each quantity in a row."""
        out, at = {}, 0
        for quantity, columns in self.joints.items():
            out[quantity] = slice(at, at + len(columns))
            at += len(columns)
        if self.power is not None:
            out["power"] = slice(at, at + 1)
            at += 1
        if self.driven:
            out["torque"] = slice(at, at + len(self.gain))
        return out

    @cached_property
    def judged(self) -> tuple[Judged, ...]:
        """The channels that are compared, torques first."""
        torques = [
            Judged(f"{self.source}.joint_{j}.torque", unit, j, f"The torque of joint {j}")
            for j, unit in enumerate(self.efforts, start=1)
        ]
        return (*torques, *([] if self.power is None else [Judged(self.power_name, "W", None, "The supply's power")]))

    @cached_property
    def _columns(self) -> list[int]:
        columns = [c for family in self.joints.values() for c in family]
        return columns if self.power is None else [*columns, self.power]

    def rows(self, frames: Frames) -> Float:
        """Values (N, width) in the order of ``places``; torque in Nm, NaN where missing or not measured."""
        rows = frames.values[:, self._columns]
        if self.driven:
            return np.column_stack([rows, np.full((len(rows), len(self.gain)), np.nan)])
        rows[:, self.places[self.measured]] *= self.gain
        return rows


def intake(layout: Layout, arm: str | None, power: str | None, robot: RobotDescription) -> Intake:
    """The columns of an arm with the joints of ``robot``, which gives their kinds and torque constants.

    Without torque and current, target positions are the commands of its servos. Raises ``ConfigError`` if a quantity is
    missing, or has another unit.
    """
    constants = robot.column("torque_constant")
    positions = layout.joints("position", arm)
    source = layout.channels[positions[0]].source
    if len(positions) != len(constants):
        raise ConfigError(f"source {source} has {len(positions)} joints, the robot's description {len(constants)}")
    joints: dict[str, tuple[int, ...]] = {}
    for quantity, unit in UNITS.items():
        names = [f"{source}.joint_{i + 1}.{quantity}" for i in range(len(constants))]
        if set(names) <= set(layout.names) and not (quantity == "current" and "torque" in joints):
            joints[quantity] = tuple(layout.index(name, robot.unit(i, unit)) for i, name in enumerate(names))
    if "torque" not in joints and "current" not in joints:
        if "target_position" not in joints:
            raise ConfigError(f"source {source} gives no joint_1.torque, joint_1.current or joint_1.target_position")
        used = {q: joints[q] for q in ("position", "temperature") if q in joints}
        joints = used | {"command": joints["target_position"]}
    gain = constants if "current" in joints else np.ones(len(constants))
    if unknown := [f"joint {i + 1}" for i, value in enumerate(gain) if value == 0]:
        raise ConfigError(
            f"source {source} gives currents but no torques, and the torque_constant of "
            f"{', '.join(unknown)} is 0: set it in the robot's description, in Nm/A at the joint side"
        )
    metered = power is not None or any(channel.short == SUPPLY for channel in layout.channels)
    supply = layout.index(power or SUPPLY, "W") if metered else None
    efforts = tuple(robot.unit(i, "Nm") for i in range(len(constants)))
    return Intake(source, joints, supply, "" if supply is None else layout.names[supply], gain, efforts)


def streamed(source: str, layout: Layout, intake: Intake) -> list[int] | None:
    """Columns of a simulation that source ``source`` streams, as ``Intake.judged``; None if there is no such source.

    Raises ``ConfigError`` if the source lacks a torque, or power where the supply is compared, or if the arm has no
    torque.
    """
    if all(channel.source != source for channel in layout.channels):
        return None
    if intake.driven:
        raise ConfigError(f"source {intake.source} gives no torque to compare with that of {source}")
    names = [f"{source}.joint_{j + 1}.torque" for j in range(len(intake.gain))]
    names += [] if intake.power is None else [f"{source}.{SUPPLY}"]
    if missing := [name for name in names if name not in layout.names]:
        raise ConfigError(f"source {source} must stream the simulation, but gives no {', '.join(missing)}")
    return [layout.index(name, judged.unit) for name, judged in zip(names, intake.judged, strict=True)]
