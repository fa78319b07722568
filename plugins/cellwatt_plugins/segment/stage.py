"""The ``segment`` stage: computes intervals and tasks from frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cellwatt.errors import ConfigError
from cellwatt.frames import Frames, Layout
from cellwatt.results import Interval, Result
from cellwatt.stage import CellInfo, Stage
from cellwatt_plugins.segment.intervals import Segmenter
from cellwatt_plugins.segment.settings import SegmentSettings
from cellwatt_plugins.segment.tasks import TaskRecogniser
from cellwatt_plugins.travel import levers_of, scaled


class SegmentStage(Stage[SegmentSettings]):
    """Reports each ``Interval`` twice (open once confirmed, then closed), and a ``Task`` at each repetition."""

    Settings = SegmentSettings
    title = "intervals by the set of moving joints, and the tasks that recur"

    def __init__(self, name: str, settings: SegmentSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        self._columns = list(layout.joints("position", settings.arm))
        if wrong := [layout.channels[c] for c in self._columns if layout.channels[c].unit not in ("rad", "m")]:
            raise ConfigError(f"stage {name!r}: {wrong[0].name} is in {wrong[0].unit}, expected rad, or m of a slide")
        self._levers = levers_of(layout, self._columns)
        source = layout.channels[self._columns[0]].source
        self._segmenter = Segmenter(source, len(self._columns), layout.step, settings)
        self._tasks = TaskRecogniser(settings)

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the intervals and tasks found with this block."""
        positions = np.ascontiguousarray(frames.values[:, self._columns] / self._levers)
        return self._with_tasks(self._segmenter.update(frames.time, positions))

    def close(self) -> Sequence[Result]:
        """Close and return the open interval."""
        return self._with_tasks(self._segmenter.finish())

    def _with_tasks(self, intervals: Iterable[Interval]) -> list[Result]:
        out: list[Result] = []
        for interval in intervals:
            out.append(scaled(interval, self._levers))
            if interval.closed:
                out.extend(self._tasks.update(interval))
        return out
