"""Curves of a cell's recordings for a browser: short spans from the frames themselves, long spans from levels."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, Grid, chosen, coarser, fitting, of_samples, span_of
from cellwatt.outlets.page.levels.episodes import Memory, marks
from cellwatt.outlets.page.levels.following import Pace
from cellwatt.outlets.page.levels.gathering import CURVES, Samples, samples_of
from cellwatt.outlets.page.levels.store import Store, ends_at, near
from cellwatt.outlets.page.shapes import significant
from cellwatt.record.folder import RecordFile
from cellwatt.record.survey import open_recording

PATIENCE: Final = 5.0
"""Time, s, after which the answer is returned incomplete."""
MOMENTS: Final = 60 * 10**9
"""Longest span, ns, that is read from the frames themselves, …"""
FINER: Final = STEPS[0] // 2
"""… if the requested step is shorter than this, ns."""
BESIDE: Final = 10**9
"""Margin, ns, read on both sides of a span: more than the step of most frames."""
USUAL: Final = 20_000_000
"""Assumed step of frames, ns, if it is unknown."""
EXACT: Final = 9
"""Significant digits that represent a single-precision number exactly."""


def curves(
    store: Store, channels: Sequence[str], start_ms: float, end_ms: float, points: int, memory: Memory = Memory()
) -> dict[str, Any]:
    """Curves, intervals and alarms from ``start_ms`` to before ``end_ms``, UTC ms, ready for JSON.

    There are at most ``points`` (2 or more) times ``t``, ms. ``v`` contains by channel ``min`` and ``max`` of all
    samples from each time to the next, None without samples; the first step begins at or before ``start_ms``. In a
    short span, the last step contains the newest sample; if a step is one frame, there is no ``max``. Channels are
    those of the frames, or ``prediction/<model>/<output>``; for a channel that was not recorded all values are None.
    ``memory`` contains data that may not be recorded yet. ``complete`` is false if data are left out, for lack of time
    or because there are too many. Never call it on an event loop.

    Raises ``RecordingError`` if the folder cannot be read.
    """
    start, end = span_of(start_ms, end_ms)
    recordings, pace = store.recordings(), ends_at(time.monotonic() + PATIENCE)
    asked = _Question(store, recordings, list(dict.fromkeys(channels)), start, end, max(points, 2), pace, memory)
    try:
        found = asked.moments() or asked.levels()
        told = marks(store, recordings, start, end, pace, memory)
    except OSError as error:
        raise RecordingError(f"record.folder {store.folder} cannot be read: {why(error)}") from error
    complete = found.pop("complete") and told.pop("complete")
    return {**found, **told, "from_record": store.recorded, "complete": complete}


@dataclass(frozen=True, slots=True)
class _Question:
    """A request and the recordings present; times UTC ns. ``pace`` raises ``TimeoutError`` when the time is over."""

    store: Store
    recordings: Sequence[RecordFile]
    names: Sequence[str]
    start: int
    end: int
    points: int
    pace: Pace
    memory: Memory

    def moments(self) -> dict[str, Any] | None:
        """Curves of a short span from the frames; None if levels are the better source."""
        length, points = self.end - self.start, self.points
        if length > MOMENTS or length >= points * FINER:
            return None
        beside = length // (points - 1) + BESIDE  # the first and the last step extend beyond the span
        try:
            step, samples = self._samples(self.start - beside, self.end + beside)
        except TimeoutError:
            return None
        if step > BESIDE:
            return None
        newest = max((int(t[-1]) for each in samples.values() for t, _ in each if len(t)), default=self.start)
        grid = fitting(self.start, max(min(self.end, newest + 1), self.start + 1), points, step)
        found = _drawn(grid, {name: [_bucketed(grid, *each)] if each else [] for name, each in samples.items()})
        for values in found["v"].values() if grid.step == step else ():
            del values["max"]
        return {**found, "complete": True}

    def _samples(self, start: int, end: int) -> tuple[int, Mapping[str, Sequence[Samples]]]:
        """Step of the frames, and the samples of each channel from ``start`` to before ``end``, UTC ns, or more.

        Raises ``TimeoutError`` if that takes too long, ``OSError`` if the disk cannot be read.
        """
        steps = set[int]()
        pieces: dict[str, list[Samples]] = {name: [] for name in self.names}
        for kept in near(self.recordings, start, end):
            known = self.store.known(kept) if kept.closed else None
            if known is not None and (known.end < start or known.start >= end):
                continue
            # Skip a recording that was removed meanwhile or is unreadable.
            with suppress(FileNotFoundError, RecordingError):
                places = self.store.places(kept, self.pace)
                _, file = open_recording(kept.path)
                with file:
                    for items in places.items(file, CURVES, start, end):
                        for item in items:
                            steps |= {item.layout.step} if isinstance(item, Frames) else set()
                            if (found := samples_of(item)) is not None:
                                columns, times, values = found
                                for name in pieces.keys() & set(columns):
                                    pieces[name].append((times, values[:, columns.index(name)]))
                        self.pace()
        for name in pieces.keys() & self.memory.samples.keys():
            pieces[name].append(self.memory.samples[name])
        return min(steps, default=self.memory.step or USUAL), pieces

    # long spans -----------------------------------------------------------------------------------

    def levels(self) -> dict[str, Any]:
        """Curves from the level files; missing ones are written, newest first, while there is time."""
        level, grid = chosen(self.start, self.end, self.points)
        parts: dict[str, list[Buckets]] = {name: [] for name in self.names}
        complete = True
        for kept in reversed(near(self.recordings, grid.start, grid.end)):
            try:
                found = self.store.read(kept, self.pace, lambda source: list(source.levels(level, self.names)))
            except TimeoutError:
                complete = False
                continue
            for name, buckets in found or ():
                parts[name].append(coarser(buckets, grid.step // STEPS[level]))
        for name in parts.keys() & self.memory.samples.keys():
            parts[name].append(_bucketed(grid, self.memory.samples[name]))
        return {**_drawn(grid, parts, EXACT), "complete": complete}


def _bucketed(grid: Grid, *pieces: Samples) -> Buckets:
    """Buckets, with the step of ``grid``, of the samples of one channel."""
    times, values = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    return of_samples(times, values[:, None], grid.step)


def _drawn(grid: Grid, parts: Mapping[str, Sequence[Buckets]], digits: int | None = None) -> dict[str, Any]:
    times = (grid.first + np.arange(grid.count)) * grid.step
    values = {}
    for name, buckets in parts.items():
        extremes = grid.extremes(buckets)
        low, high = extremes if digits is None else significant(extremes, digits)
        values[name] = {"min": _plain(low), "max": _plain(high)}
    return {"t": (times / 1e6).tolist(), "v": values, "step_ms": grid.step / 1e6}


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    """Values for JSON, None if not finite."""
    plain: list[float | None] = np.where(np.isfinite(values), values, np.array(None)).tolist()
    return plain
