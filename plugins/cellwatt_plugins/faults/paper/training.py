"""Learns the fault table of each task from cycles with known faults, and the paper's network from the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ModelError
from cellwatt.progress import steps
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.paper.columns import column_of, simulated
from cellwatt_plugins.faults.paper.course import Course, Key
from cellwatt_plugins.faults.paper.expected import fault_table
from cellwatt_plugins.faults.paper.network import groups_of, train
from cellwatt_plugins.faults.paper.trained_for import TrainedFor

Codes = NDArray[np.int8]
Origin = Literal["recorded", "simulated", "at rest"]


@dataclass(frozen=True)
class Column:
    """Codes (intervals,) of each of ``cycles`` with a fault of one joint, and where they are from."""

    origin: Origin
    cycles: Sequence[Codes]


@dataclass(frozen=True)
class Sources:
    """Sources of cycles with a fault: codes of recorded ones by joint (from 1) and task; the ``arm`` to simulate
    springs on, if any."""

    recorded: Mapping[int, Mapping[Key, Sequence[Codes]]]
    arm: FittedArm | None
    tolerance: Tolerance

    def column(self, course: Course, joint: int) -> Column:
        """A joint's (from 1) column of a course's table. Raises ``ModelError`` where no cycle has a fault of it."""
        if not fault_table(course.intervals)[:, joint - 1].any():
            return Column("at rest", [np.zeros(len(course.intervals), np.int8)])
        if cycles := self.recorded.get(joint, {}).get(course.key):
            return Column("recorded", cycles)
        if self.arm is not None:
            return Column("simulated", simulated(self.arm, course, joint, self.tolerance))
        raise ModelError(
            f"{course.task} at speed {course.speed:.2f}: no cycle with a fault of joint {joint}: give --fault "
            f"{joint}=RECORDING, or --robot with a description of the robot to simulate one"
        )


@dataclass(frozen=True)
class CodeNetwork:
    """A task's ``table`` (intervals, joints) as it was learnt, column by column, and its network as an ONNX file; None
    where no fault moves the power beyond its tolerance, so that there is nothing to tell apart."""

    course: Course
    columns: tuple[Column, ...]
    table: Codes
    content: bytes | None

    @property
    def alike(self) -> tuple[tuple[int, ...], ...]:
        """Joints (from 1) whose columns are the same: they are named together."""
        return tuple(group for group in groups_of(self.table) if len(group) > 1)


def train_codes(course: Course, sources: Sources, seed: int = 0) -> CodeNetwork:
    """The table of a course and its network. Raises ``CellwattError``."""
    joints = range(1, course.intervals[0].readings.q.shape[1] + 1)
    columns = tuple(sources.column(course, joint) for joint in steps(joints, "cycles with a fault of joint"))
    tolerance = sources.tolerance
    made = {
        "columns": [{"origin": column.origin, "cycles": len(column.cycles)} for column in columns],
        "tolerance": {"position_rad": tolerance.position, "power": tolerance.power, "floor_W": tolerance.floor},
        "seed": seed,
    }
    table = np.stack([column_of(column.cycles) for column in columns], axis=1)
    task = TrainedFor.of(course)
    content = train(table, seed=seed, task=task, signed=True, made=made) if table.any() else None
    return CodeNetwork(course, columns, table, content)
