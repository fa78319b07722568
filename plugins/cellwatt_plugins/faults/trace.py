"""Frames of one arm, and the results of the segment stage for them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float, Nanoseconds, rows_of
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames, Layout
from cellwatt.registry import stage as find_stage
from cellwatt.results import Interval, Result, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.travel import levers_of, scaled


@dataclass(frozen=True, slots=True)
class Trace:
    """n frames: ``time`` (n,) ns rising, ``position`` (n, joints) rad, ``power`` (n,) W; NaN where missing.

    In the traces of intervals, 1 rad of a linear axis stands for a travel of ``LEVER``.
    """

    time: Nanoseconds
    position: Float
    power: Float

    @classmethod
    def of(cls, frames: Frames, positions: Sequence[int], power: int) -> Trace:
        """The trace of the arm whose positions and power are these columns of ``frames``."""
        return cls(frames.time, frames.values[:, list(positions)], frames.values[:, power])

    @classmethod
    def empty(cls, joints: int) -> Trace:
        """No frames yet."""
        return cls(np.empty(0, np.int64), np.empty((0, joints)), np.empty(0))

    def __len__(self) -> int:
        return len(self.time)

    def since(self, onset: int) -> Float:
        """Times of the frames, s from ``onset`` (ns)."""
        return np.asarray((self.time - onset) * 1e-9, dtype=np.float64)

    def between(self, start: int, end: int) -> Trace:
        """The frames from ``start`` to ``end`` ns, both included."""
        return rows_of(self, slice(np.searchsorted(self.time, start), np.searchsorted(self.time, end, side="right")))


def in_angles(trace: Trace, intervals: Iterable[Interval], levers: Float) -> tuple[Trace, list[Interval]]:
    """A trace and intervals whose linear axes have positions in m, with all positions in rad; see ``levers_of``."""
    return replace(trace, position=trace.position / levers), [scaled(each, 1 / levers) for each in intervals]


def one_layout(blocks: Sequence[Frames]) -> Layout:
    """The layout of all blocks. Raises ``RecordingError`` if there are no blocks or their layouts differ."""
    if not blocks:
        raise RecordingError("no frames in these recordings")
    layout = blocks[0].layout
    if any(block.layout != layout for block in blocks):
        raise RecordingError("the channels or the rate of the frames change from one recording to the next")
    return layout


def segmented(
    blocks: Sequence[Frames], arm: str | None, power: str
) -> Iterator[tuple[Trace, list[Interval], list[Task]]]:
    """The trace of each block with the intervals and tasks found with it, then an empty trace with the last ones.

    Positions of linear axes are ``in_angles``. ``arm`` is the source with the joints, ``power`` the power channel.
    Raises ``RecordingError`` as ``one_layout``.
    """
    layout, kind = one_layout(blocks), find_stage("segment")
    segment = kind("segment", kind.Settings.model_validate({"arm": arm}), layout, CellInfo("", "", None, Path()))
    positions, channel = layout.joints("position", arm), layout.index(power, "W")

    def cut() -> Iterator[tuple[Trace, Sequence[Result]]]:
        for frames in blocks:
            yield Trace.of(frames, positions, channel), segment.process(frames, ())
        yield Trace.empty(len(positions)), segment.close()

    for trace, results in cut():
        intervals = [each for each in results if isinstance(each, Interval)]
        tasks = [each for each in results if isinstance(each, Task)]
        yield *in_angles(trace, intervals, levers_of(layout, positions)), tasks
