"""The live side of segmentation: frames in, intervals and tasks out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from cellwatt.errors import ConfigError
from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction, Radians, Seconds, parse
from cellwatt.results import Interval, Result
from cellwatt.stage import CellInfo, Stage, StageSettings
from cellwatt_plugins.segment.intervals import Segmenter
from cellwatt_plugins.segment.motion import Thresholds
from cellwatt_plugins.segment.noise import first_that_counts
from cellwatt_plugins.segment.tasks import Likeness, TaskRecogniser

Float = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]


@dataclass(frozen=True)
class Cutting:
    """Arm whose intervals are cut, and how; ``step`` is that of its frames, ns."""

    source: str
    joints: int
    step: int
    thresholds: Thresholds

    def segmenter(self) -> Segmenter:
        """One that has seen nothing yet."""
        return Segmenter(self.source, self.joints, self.step, self.thresholds)


@dataclass(frozen=True)
class _Stretch:
    """Frames without a hole: ``time`` (n,) ns, ``positions`` (n, joints) rad, and those ``before`` that tell the noise
    of its first ones."""

    before: Float
    time: Nanoseconds
    positions: Float


def intervals_of(cutting: Cutting, time: Nanoseconds, positions: Float) -> list[Interval]:
    """Intervals of all frames, as a ``Segmenter`` gives them: ``time`` (n,) ns, ``positions`` (n, joints) rad."""
    from cellwatt.scheduler import spread  # of which a cell that cuts live needs nothing

    good = ~np.isnan(positions).any(axis=1)
    when, pose = time[good], positions[good]
    edges = [0, *(np.flatnonzero(np.diff(when) > cutting.segmenter().gap) + 1).tolist(), len(when)]
    stretches = [_Stretch(pose[first_that_counts(a) : a], when[a:b], pose[a:b]) for a, b in pairwise(edges) if b > a]
    out: list[Interval] = []
    for cut in spread(_cut, stretches, "cutting into intervals", shared=cutting):
        before = max((interval.number for interval in out), default=0)
        out += [replace(interval, number=before + interval.number) for interval in cut]
    return out


def _cut(stretch: _Stretch, cutting: Cutting) -> list[Interval]:
    segmenter = cutting.segmenter()
    segmenter.hear(stretch.before)
    return [*segmenter.update(stretch.time, stretch.positions), *segmenter.finish()]


_SPEEDS = {"rad/s": 1.0, "deg/s": math.pi / 180}


def _speed(value: object) -> float:
    number = value if type(value) is float else parse(value, _SPEEDS, "1 deg/s")
    if number <= 0:
        raise ValueError("must be above zero, like '1 deg/s'")
    return number


Speed = Annotated[float, BeforeValidator(_speed), WithJsonSchema({"type": "string", "examples": ["1 deg/s"]})]


class SegmentSettings(StageSettings):
    """Cuts the motion of one arm into intervals and tasks, from its encoder positions alone."""

    arm: str | None = None
    """Source with the joints; may be left out where only one source has joints."""
    start_speed: Speed = math.radians(1.0)
    """A joint starts to move above this speed; raised on its own where the encoder noise asks for more."""
    stop_speed: Speed = math.radians(0.5)
    """A joint has come to rest below this speed."""
    window: Seconds = Field(default=0.08, gt=0)
    """Time over which speed is taken from positions."""
    confirm: int = Field(default=3, ge=1, le=50)
    """Frames in a row that must agree before a joint counts as started or stopped."""
    minimum_length: Seconds = Field(default=0.12, ge=0)
    """Sets of moving joints that last less belong to their neighbours."""
    minimum_travel: Radians = Field(default=math.radians(1.0), ge=0)
    """Joints that join before any other has moved as far belong to the same interval from its start."""
    gap: Seconds = Field(default=0.1, gt=0)
    """Positions missing for longer cut the interval."""
    same_displacement: Radians = Field(default=math.radians(2.0), gt=0)
    """Moves are the same up to this difference in each joint's displacement (what moves less counts as rest) …"""
    same_pose: Radians = Field(default=math.radians(6.0), gt=0)
    """… and up to this difference in each joint's start position."""
    same_speed: Fraction = Field(default=0.03, gt=0)
    """Repetitions of a task whose moving time differs by less are one variant."""

    @model_validator(mode="after")
    def _hysteresis(self) -> SegmentSettings:
        if self.stop_speed > self.start_speed:
            raise ValueError("stop_speed must not be above start_speed")
        return self


class SegmentStage(Stage[SegmentSettings]):
    """Gives an ``Interval`` twice (open once confirmed, then closed) and a ``Task`` at each repetition."""

    Settings = SegmentSettings
    title = "intervals by the set of moving joints, and the tasks that recur"

    def __init__(self, name: str, settings: SegmentSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        self._columns = list(layout.joints("position", settings.arm))
        if wrong := [layout.channels[c] for c in self._columns if layout.channels[c].unit not in ("rad", "m")]:
            raise ConfigError(f"stage {name!r}: {wrong[0].name} is in {wrong[0].unit}, expected rad, or m of a slide")
        thresholds = Thresholds(**{key.name: getattr(settings, key.name) for key in fields(Thresholds)})
        source = layout.channels[self._columns[0]].source
        self._cutting = Cutting(source, len(self._columns), layout.step, thresholds)
        self._segmenter = self._cutting.segmenter()
        self._tasks = TaskRecogniser(Likeness(settings.same_displacement, settings.same_pose, settings.same_speed))

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Intervals and tasks that became known with this block."""
        positions = np.ascontiguousarray(frames.values[:, self._columns])
        return self._with_tasks(self._segmenter.update(frames.time, positions))

    def close(self) -> Sequence[Result]:
        """The interval that was still open."""
        return self._with_tasks(self._segmenter.finish())

    def of_recording(self, blocks: Sequence[Frames]) -> Sequence[Result]:
        """Intervals and tasks of a whole recording at once: those that a new stage gives block by block."""
        time = np.concatenate([frames.time for frames in blocks])
        positions = np.concatenate([frames.values[:, self._columns] for frames in blocks])
        return self._with_tasks(intervals_of(self._cutting, time, positions))

    def _with_tasks(self, intervals: Iterable[Interval]) -> list[Result]:
        out: list[Result] = []
        for interval in intervals:
            out.append(interval)
            if interval.closed:
                out.extend(self._tasks.update(interval))
        return out
