"""The ``faults`` stage: computes alarms from frames and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from cellwatt.arrays import joined
from cellwatt.errors import ModelError
from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction
from cellwatt.results import Alarm, Interval, Result
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.intervals.alarms import IntervalAlarms
from cellwatt_plugins.faults.intervals.judge import Judge, Rules
from cellwatt_plugins.faults.on_reference import ReferenceSettings, ReferenceStage
from cellwatt_plugins.faults.trace import Trace

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.live import CycleStage

EVERY = 3
"""A running interval is judged at every third grid point."""
KEEP = 60 * 10**9
LONGEST = 600 * 10**9
"""Length of the frames stored, ns: always, and at most for a running interval …"""
MARGIN = 10**9
"""… plus this margin."""


class FaultsSettings(ReferenceSettings):
    """Compares an arm with its healthy reference and names the faulty joint or encoder."""

    robot: Path | None = None
    """Description of the robot (``robot.yaml``), the same as for `cellwatt reference`: whole cycles are judged by the
    physics of the arm; ``tolerance``, ``confirm`` and ``jitter`` are not used."""
    confirm: int = Field(default=5, ge=2, le=100)
    """Consecutive frames outside the tolerance that count as a deviation."""
    jitter: int = Field(default=2, ge=0, le=10)
    """Frames by which the detected start of an interval may be early or late."""
    false_alarms: Fraction = Field(default=1e-4, gt=0, le=0.1)
    """Accepted share of healthy intervals with a false alarm; used with ``robot`` only."""
    clear: int = Field(default=3, ge=1, le=100)
    """Number of healthy intervals, or with ``robot`` cycles, after which an alarm is cleared."""


class FaultsStage(ReferenceStage[FaultsSettings]):
    """Raises alarms ``joint_fault``, ``encoder_fault``, ``joint_and_encoder_fault``, ``new_task``, ``new_speed``."""

    Settings = FaultsSettings
    title = "faulty joints and encoders, from power and positions against healthy cycles"

    def __init__(self, name: str, settings: FaultsSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        if settings.robot is None and not self._reference.tasks:
            raise ModelError(
                f"reference {self._path}: has whole cycles only: set robot to the description of the robot"
            )
        rules = Rules(settings.tolerance, settings.confirm, settings.jitter * layout.step * 1e-9)
        self._judge = Judge(self._reference, rules)
        self._alarms = IntervalAlarms(name, self._source, self._reference, self._levers, settings.clear)
        self._trace = Trace.empty(len(self._positions))
        self._open: Interval | None = None
        self._cycles = None if settings.robot is None else self._watched(cell.folder / settings.robot)

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the alarms that changed with this block."""
        if self._cycles is not None:
            return self._cycles.process(Trace.of(frames, self._positions, self._power))
        block, intervals = self._seen(frames, upstream)
        self._trace = joined([self._trace, block])
        out: list[Alarm] = []
        first = int(frames.time[0]) if len(frames) else 0
        for known_at, interval in _when_known(intervals):
            out += self._watch(first, known_at)
            first = max(first, known_at)
            out += self._take(interval)
        if len(frames):
            out += self._watch(first, int(frames.time[-1]) + 1)
        self._forget()
        return out

    def close(self) -> Sequence[Result]:
        """Return the alarms of the last cycle if whole cycles are judged."""
        return [] if self._cycles is None else self._cycles.close()

    def _watched(self, robot: Path) -> CycleStage:
        """The judge of whole cycles; its modules are imported here, as only cells with ``robot`` need them."""
        from cellwatt_plugins.faults.cycles.known import known_of
        from cellwatt_plugins.faults.cycles.live import CycleStage

        known = known_of(self._reference, self._path, robot, self.settings.false_alarms)
        return CycleStage(known, self.layout.step, CycleAlarms(self.name, self._source, self.settings.clear))

    def _take(self, interval: Interval) -> list[Alarm]:
        """Process an interval that has begun or ended."""
        self._open = None if interval.closed else interval
        if not interval.closed or not (interval.moving or not interval.complete):
            return []
        findings = self._judge.closed(interval, self._trace)
        return [alarm for finding in findings for alarm in self._alarms.take(finding, final=True)]

    def _watch(self, start: int, end: int) -> list[Alarm]:
        """Judge the open interval at every ``EVERY``-th grid point from ``start`` to before ``end`` (ns)."""
        if self._open is None or not self._open.moving:
            return []
        first, last = np.searchsorted(self._trace.time, [start, end])
        out: list[Alarm] = []
        for now in self._trace.time[first:last].tolist():
            if now // self.layout.step % EVERY == 0:
                finding = self._judge.running(self._open, self._trace, now)
                if finding is not None:
                    out += self._alarms.take(finding, final=False)
        return out

    def _forget(self) -> None:
        """Discard frames that no interval can need any more."""
        if len(self._trace):
            newest = int(self._trace.time[-1])
            begun = self._open.start if self._open is not None else newest
            keep = max(min(begun, newest - KEEP), newest - LONGEST)
            self._trace = self._trace.between(keep - MARGIN, newest)


def _when_known(intervals: Sequence[Interval]) -> list[tuple[int, Interval]]:
    """Each interval with the time (ns) of the frame at which it was found, which is the ``end`` of an open interval."""
    out: list[tuple[int, Interval]] = []
    known = 0
    for interval in reversed(intervals):
        known = interval.end if not interval.closed or not known else known
        out.append((known, interval))
    return out[::-1]
