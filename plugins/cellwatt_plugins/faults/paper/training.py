"""Learns the fault table of each task from cycles with known faults, and trains the paper's network on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cellwatt.errors import ModelError
from cellwatt.progress import steps
from cellwatt_plugins.faults.criteria import Codes, Tolerance
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.paper.columns import column_of, simulated
from cellwatt_plugins.faults.paper.course import Course, Key
from cellwatt_plugins.faults.paper.expected import fault_table
from cellwatt_plugins.faults.paper.network import FaultNetwork, groups_of, train
from cellwatt_plugins.faults.paper.trained_for import TrainedFor


@dataclass(frozen=True)
class Sources:
    """Sources of cycles with a fault: codes of ``recorded`` ones by joint (1-based) and task, and the ``arm`` for
    simulated springs, if any. ``calm``: codes of healthy cycles by task, on which the networks are tested."""

    recorded: Mapping[int, Mapping[Key, Sequence[Codes]]]
    arm: FittedArm | None
    calm: Mapping[Key, Sequence[Codes]]
    tolerance: Tolerance
    seed: int

    def cycles(self, course: Course, joint: int) -> tuple[str, Sequence[Codes]]:
        """Origin and codes (intervals,) of each cycle with a fault of a joint (1-based).

        Raises ``ModelError`` if there is no such cycle.
        """
        if not fault_table(course.intervals)[:, joint - 1].any():
            return "at rest", [np.zeros(len(course.intervals), np.int8)]
        if cycles := self.recorded.get(joint, {}).get(course.key):
            return "recorded", cycles
        if self.arm is not None:
            return "simulated", simulated(self.arm, course, joint, self.tolerance)
        raise ModelError(
            f"{course.words}: no cycle with a fault of joint {joint}: give --fault {joint}=RECORDING, or --robot with "
            "a description of the robot to simulate one"
        )


def train_codes(course: Course, sources: Sources) -> tuple[dict[str, Any], bytes | None]:
    """Learn the fault table of a course column by column; returns the report and the network as an ONNX file.

    No network is made if no fault moves the power beyond its tolerance. Raises ``CellwattError``.
    """
    joints = range(1, course.intervals[0].readings.q.shape[1] + 1)
    cycles = [sources.cycles(course, joint) for joint in steps(joints, "cycles with a fault of joint")]
    columns = [{"origin": origin, "cycles": len(own)} for origin, own in cycles]
    table = np.stack([column_of(own) for _, own in cycles], axis=1)
    tolerance, calm, network, content = sources.tolerance, sources.calm.get(course.key, ()), None, None
    if table.any():
        within = {"position_rad": tolerance.position, "power": tolerance.power, "floor_W": tolerance.floor}
        made = {"columns": columns, "tolerance": within, "seed": sources.seed}
        content = train(table, seed=sources.seed, task=TrainedFor.of(course), signed=True, made=made)
        network = FaultNetwork(content)
    about = {
        "file": None,
        "task": course.task,
        "speed": course.speed,
        "table": table.tolist(),
        "columns": columns,
        "named_together": [group for group in groups_of(table) if len(group) > 1],
        "healthy_cycles": len(calm),
        "healthy_cycles_with_codes": sum(bool(codes.any()) for codes in calm),
        "named_in_vain": sum(network is not None and bool(network.joints(codes)) for codes in calm),
    }
    return about, content
