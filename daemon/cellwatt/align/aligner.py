"""The aligner: a state machine from batches and ticks to frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from cellwatt.align.lane import Lane
from cellwatt.align.track import NEVER, Counts
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Quality, Stream
from cellwatt.errors import ConfigError
from cellwatt.frames import FrameChannel, Frames, Layout

_SECOND = 1_000_000_000
_BLOCK = 512
"""Largest number of frames in one block."""
_HOLE = 5 * _SECOND
"""After a jump of the cell's time by more than this, frames continue at the next samples; skipped ones are counted."""
_BACKLOG = 60 * _SECOND
"""Longest backlog of samples that still enters frames after such a jump."""


class Aligner:
    """Aligns the streams of all sources to one grid of ``rate`` Hz.

    A grid point is emitted once every active stream has the samples that settle it, at the latest with the first
    entry (batch or tick) whose time is ``latency`` s past it. Values that are missing then are marked; samples that
    arrive later are counted by stream in ``counts``. The frames and their blocks depend only on the sequence of
    entries, so a replay gives the same bits. They are numbered from ``sequence``; those up to time ``after``, ns, are
    left out, as a predecessor has emitted them.

    Linear channels lie on the straight line between the neighbouring samples, averaged ones are the mean over
    the step around the grid point, held ones are the last sample. If the samples are more than 1.5 nominal periods
    apart, the value counts as interpolated; if more than 3.5 periods, as missing. Streams with a period above half
    the latency, or without a rate, are held; those without a rate for 60 s at most. The bound of a value is
    the worst clock bound of its samples plus the distance of the nearest one from the grid point, -1 where it
    is missing.

    The channel names of a source are unique. Raises ``ConfigError`` if the latency is too short to average.
    """

    def __init__(
        self,
        streams: Mapping[str, tuple[Stream, ...]],
        rate: float,
        latency: float,
        *,
        sequence: int = 0,
        after: int = NEVER,
    ) -> None:
        if not (rate > 0 and latency > 0):
            raise ConfigError("frames: rate and latency must be above 0")
        self._step = step = round(_SECOND / rate)
        self._latency = round(latency * _SECOND)
        self._lanes: dict[tuple[str, str], Lane] = {}
        channels: list[FrameChannel] = []
        for source, its_streams in streams.items():
            for stream in its_streams:
                lane = Lane(stream, len(channels), step, self._latency)
                self._lanes[source, stream.name] = lane
                channels += [
                    FrameChannel(f"{source}.{channel.name}", channel.unit, channel.kind, method, channel.window)
                    for channel, method in zip(stream.channels, lane.methods, strict=True)
                ]
                _check(source, stream, lane, step, self._latency)
        self.layout = Layout(tuple(channels), rate)
        self.skipped = 0
        """Frames skipped because the cell's time jumped."""
        self.sequence = sequence
        """Number of the next frame."""
        self._now = self._given_out = NEVER
        self._after = after
        self._next: int | None = None  # number of the next grid point: its time in steps

    @property
    def counts(self) -> Mapping[tuple[str, str], Counts]:
        """Counts of samples that did not enter their frames, by source and stream."""
        return {key: lane.track.counts for key, lane in self._lanes.items()}

    @property
    def reached(self) -> int:
        """Time of the last frame, ns: the ``after`` of a successor."""
        return max(self._after, self._given_out)

    def status(self) -> dict[str, Any]:
        """Counts of emitted frames, of samples that missed theirs by stream, and of skipped frames; JSON-ready."""
        streams = {f"{source}/{stream}": asdict(found) for (source, stream), found in self.counts.items()}
        return {"count": self.sequence, "streams": streams | {"cell": {"skipped": self.skipped}}}

    def add(self, entry: Batch | Tick) -> list[Frames]:
        """Add a batch, or advance the cell's time by a tick; return the frames that are settled or overdue now.

        Raises ``KeyError`` for an undeclared stream.
        """
        if isinstance(entry, Tick):
            self._now = max(self._now, entry.time)
            return self._move_on()
        batch, lane = entry, self._lanes[entry.source, entry.stream.name]
        self._now = max(self._now, batch.arrival)
        if not len(batch):
            return self._move_on()
        if self._next is None:
            # The first grid point is at the first sample, but no further back than the latency.
            begin = max(int(batch.time[0]), self._now - self._latency, self._after + 1)
            self._next = -(-begin // self._step)
            for known in self._lanes.values():
                known.start = self._now
        following = self._following
        lane.hear(batch, self._given_out, self._now + self._latency)
        if lane.settled >= following or self._now >= following + self._latency:
            return self._move_on()
        return []

    def flush(self) -> list[Frames]:
        """Return all frames up to the newest sample, missing values marked, at the end of the data."""
        newest = max(lane.track.newest for lane in self._lanes.values()) if self._lanes else self._now
        return self._give_out(newest // self._step)

    @property
    def _following(self) -> int:
        """Time of the next grid point, ns."""
        return (self._next or 0) * self._step

    def _move_on(self) -> list[Frames]:
        if self._next is None:
            return []
        now = self._now
        awaited = [lane.settled for lane in self._lanes.values() if lane.awaited(now)]
        overdue = now - self._latency
        ready = min(now, *awaited) if awaited else overdue
        return self._give_out(max(ready, overdue) // self._step)

    def _give_out(self, newest: int) -> list[Frames]:
        """Frames from the next grid point up to number ``newest``."""
        if self._next is None or newest < self._next:
            return []
        if newest - self._next > _HOLE // self._step:
            self._leave_out(newest)
        blocks = [self._frames(k, min(k + _BLOCK, newest + 1)) for k in range(self._next, newest + 1, _BLOCK)]
        self._next, self._given_out = newest + 1, newest * self._step
        needed = self._following - self._step // 2
        for lane in self._lanes.values():
            lane.track.forget(needed)
        return blocks

    def _leave_out(self, newest: int) -> None:
        """Continue at the first sample after the jump, if that leaves a gap of more than ``_HOLE``."""
        end, before = newest * self._step, self._following + self._latency
        times = [lane.track.samples.time for lane in self._lanes.values()]
        resumed = min(int(time[time > max(before, end - _BACKLOG)].min(initial=end)) for time in times) // self._step
        if self._next is not None and resumed - self._next > _HOLE // self._step:
            self.skipped += resumed - self._next
            self._next = resumed

    def _frames(self, first: int, end: int) -> Frames:
        grid = np.arange(first, end, dtype=np.int64) * self._step
        shape = (len(grid), len(self.layout.channels))
        values, quality, bound = np.zeros(shape), np.empty(shape, np.uint8), np.empty(shape, np.int64)
        for lane in self._lanes.values():
            lane.fill(grid, values, quality, bound)
        missing = (quality == Quality.MISSING) | np.isnan(values)
        values[missing], quality[missing], bound[missing] = np.nan, Quality.MISSING, -1
        frames = Frames(self.layout, self.sequence, grid, values, quality, bound)
        self.sequence += len(grid)
        return frames


def _check(source: str, stream: Stream, lane: Lane, step: int, latency: int) -> None:
    needed = step / 2 + (_SECOND / stream.rate if stream.rate else 0)
    if "average" in lane.methods and latency < needed:
        raise ConfigError(
            f"frames: a latency of {latency / 1e6:g} ms is too short to average {source}.{stream.name} over the "
            f"grid step of {step / 1e6:g} ms: expected at least {needed / 1e6:g} ms"
        )
