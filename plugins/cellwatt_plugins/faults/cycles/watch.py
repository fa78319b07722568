"""Judge frames where the arm is known: cycles in, alarms out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ModelError
from cellwatt.results import Alarm
from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.cycles.known import Known, restored
from cellwatt_plugins.faults.cycles.live import CycleWatch, Told
from cellwatt_plugins.faults.reference import Reference
from cellwatt_plugins.robot import Arm

Float = NDArray[np.float64]


def known_of(reference: Reference, path: Path, robot: Path, false_alarms: float) -> Known:
    """Return the knowledge that a reference (of the file ``path``) has of a described robot.

    ``false_alarms``: share of healthy intervals in which one is accepted. Raises ``ModelError`` where the reference has
    no cycles or is of another arm.
    """
    if reference.power_model is None or not reference.cycles:
        raise ModelError(f"reference {path}: has no cycles; learn it again with --robot {robot}")
    known = restored(reference.power_model, reference.cycles, Arm.load(robot))
    return replace(known, false_alarms=false_alarms)


class CycleStage:
    """Whole cycles of one arm judged while frames of ``step`` ns come."""

    def __init__(self, known: Known, step: int, alarms: CycleAlarms) -> None:
        self._watch = CycleWatch(known, step * 1e-9)
        self._alarms = replace(alarms, behind=self._watch.behind)
        self._count = 0
        self._epoch: int | None = None

    def process(self, time: NDArray[np.int64], position: Float, power: Float) -> list[Alarm]:
        """Alarms that changed with n frames: ``time`` (n,) ns, ``position`` (n, joints) rad, ``power`` (n,) W."""
        if not len(time):
            return []
        if self._epoch is None:
            self._epoch = int(time[0])
        seconds = np.asarray((time - self._epoch) * 1e-9, np.float64)
        return self._alarmed(self._watch.feed(seconds, position, power), self._epoch)

    def close(self) -> list[Alarm]:
        """Alarms that the end of the frames settles."""
        return [] if self._epoch is None else self._alarmed(self._watch.close(), self._epoch)

    def _alarmed(self, told: Sequence[Told], epoch: int) -> list[Alarm]:
        out: list[Alarm] = []
        for cycle in told:
            self._count += cycle.over
            if cycle.over:
                out += self._alarms.take(cycle.finding, self._count, epoch)
            else:
                out += self._alarms.take_early(cycle.finding, epoch)
        return out
