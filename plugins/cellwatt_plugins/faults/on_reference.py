"""Base of the live stages that compare an arm with its healthy reference."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from cellwatt.errors import ModelError
from cellwatt.frames import Layout
from cellwatt.stage import CellInfo, Stage
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.robot_name import RobotStageSettings, robot_name
from cellwatt_plugins.travel import levers_of


class ReferenceSettings(RobotStageSettings):
    """Settings of the stages that compare an arm with its healthy reference."""

    reference: Path
    """File written by ``cellwatt reference``; relative to the cell's file."""
    arm: str | None = None
    """Source with the joints; by default that of the reference, or the only one with joints."""
    power: str | None = None
    """Channel of the supply's power; by default that of the reference."""


S = TypeVar("S", bound=ReferenceSettings)


class ReferenceStage(Stage[S]):
    """Compares an arm with its healthy reference.

    Raises ``ConfigError`` if a channel is missing or has another unit, ``ModelError`` if the reference belongs to
    another robot.
    """

    needs = ("segment",)

    def __init__(self, name: str, settings: S, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        path = self._path = cell.folder / settings.reference
        reference = self._reference = load(path)
        robot = robot_name(cell)
        if reference.robot and robot and reference.robot != robot:
            raise ModelError(f"reference {path}: is of robot {reference.robot}, the cell's robot is {robot}")
        self._positions = layout.joints("position", reference.source(layout, settings.arm))
        self._levers = levers_of(layout, self._positions)
        self._source = layout.channels[self._positions[0]].source
        if len(self._positions) != reference.joints:
            raise ModelError(
                f"reference {path}: has {reference.joints} joints, source {self._source} has {len(self._positions)}"
            )
        self._power = layout.index(settings.power or reference.power, "W")
