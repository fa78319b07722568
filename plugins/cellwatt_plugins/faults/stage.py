"""The ``faults`` stage: computes alarms from frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction
from cellwatt.results import Result
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.cycles.known import known_of
from cellwatt_plugins.faults.cycles.live import CycleStage
from cellwatt_plugins.faults.on_reference import ReferenceSettings, ReferenceStage
from cellwatt_plugins.faults.trace import Trace


class FaultsSettings(ReferenceSettings):
    """Compares an arm with its healthy reference and names the faulty joint or encoder."""

    robot: Path | None = None
    """Description of the robot (``robot.yaml``), the same as for `cellwatt reference`: its physics find more faults."""
    false_alarms: Fraction = Field(default=1e-4, gt=0, le=0.1)
    """Accepted share of healthy intervals with a false alarm."""
    clear: int = Field(default=3, ge=1, le=100)
    """Number of cycles without the fault after which its alarm is cleared."""


class FaultsStage(ReferenceStage[FaultsSettings]):
    """Raises alarms ``joint_fault``, ``encoder_fault``, ``joint_and_encoder_fault`` and ``new_task``."""

    Settings = FaultsSettings
    title = "faulty joints and encoders, from power and positions against healthy cycles"

    def __init__(self, name: str, settings: FaultsSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        robot = None if settings.robot is None else cell.folder / settings.robot
        known = known_of(self._reference, self._path, robot, self._levers, settings.false_alarms)
        self._cycles = CycleStage(known, layout.step, CycleAlarms(name, self._source, settings.clear))

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the alarms that changed with this block."""
        return self._cycles.process(Trace.of(frames, self._positions, self._power))

    def close(self) -> Sequence[Result]:
        """Return the alarms of the last cycle."""
        return self._cycles.close()
