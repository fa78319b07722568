"""Curves of a cell's record for a browser: short spans from the frames themselves, long ones from levels."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, Grid, chosen, coarser, fitting, of_samples, span_of
from cellwatt.outlets.page.levels.episodes import marks
from cellwatt.outlets.page.levels.gathering import CURVES, Samples, samples_of
from cellwatt.outlets.page.levels.store import Keeper, Store, ends_at, near
from cellwatt.outlets.page.shapes import significant
from cellwatt.record.opening import open_recording
from cellwatt.record.retention import Kept

PATIENCE: Final = 5.0
"""s after which an answer is given as far as it goes."""
MOMENTS: Final = 60 * 10**9
"""Longest span, ns, that is answered from the frames themselves, …"""
FINER: Final = STEPS[0] // 2
"""… where the step asked for is shorter than this, ns."""
BESIDE: Final = 10**9
"""ns, more than the step of most frames."""
EXACT: Final = 9
"""Significant digits that tell a single-precision number from all others."""

Memory = tuple[int, Mapping[str, Samples]]
"""Step of frames, ns, and samples by channel."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """A question, with the recordings that are there; times UTC ns, ``until`` monotonic s."""

    recordings: Sequence[Kept]
    names: Sequence[str]
    start: int
    end: int
    points: int
    until: float
    memory: Memory


class Curves:
    """Answers about the recordings of ``cell`` in ``folder``, which it only reads; without one from memory alone.

    Level files stand in ``levels``, of the newest recordings as far as ``most`` bytes go; ``keeper`` makes them.
    """

    def __init__(self, folder: Path | None, cell: str, most: float = math.inf) -> None:
        self._recorded = folder is not None
        self.store = Store(folder or Path(), cell, most)
        self.keeper = Keeper(self.store)

    def curves(
        self, channels: Sequence[str], start_ms: float, end_ms: float, points: int, memory: Memory = (0, {})
    ) -> dict[str, Any]:
        """Curves from ``start_ms`` to before ``end_ms`` UTC ms, and the intervals and alarms there, JSON-ready.

        There are at most ``points`` (2 or more) times ``t``, ms. ``v`` has by channel ``min`` and ``max`` of all
        samples from each time to the next, None where there are none; the first step begins at or before ``start_ms``.
        Where a step is one frame, ``t`` are the frames' own times and there is no ``max``. Channels are those of the
        frames, or ``prediction/<model>/<output>``; of one that was not recorded all is None. ``memory`` has what may
        not be recorded yet. ``complete`` is false where something is left out, for want of time or because it is too
        much. Never call it on an event loop.

        Raises ``CellwattError`` for a span that is none, and where the folder cannot be read.
        """
        start, end = span_of(start_ms, end_ms)
        recordings, until = self.store.recordings() if self._recorded else [], time.monotonic() + PATIENCE
        asked = _Asked(recordings, list(dict.fromkeys(channels)), start, end, max(points, 2), until, memory)
        try:
            found = self._moments(asked) or self._levels(asked)
            told = marks(self.store, recordings, start, end, until)
        except OSError as error:
            raise RecordingError(f"record.folder {self.store.folder} cannot be read: {why(error)}") from error
        complete = found.pop("complete") and told.pop("complete")
        return {**found, **told, "from_record": self._recorded, "complete": complete}

    # short spans ----------------------------------------------------------------------------------

    def _moments(self, asked: _Asked) -> dict[str, Any] | None:
        """Curves out of the frames; None where levels serve better."""
        start, end, points = asked.start, asked.end, asked.points
        if end - start > MOMENTS or end - start >= points * FINER:
            return None
        beside = (end - start) // (points - 1) + BESIDE  # the first and the last step reach beyond the span
        first, last = start - beside, end + beside
        try:
            step, samples = self._samples(asked, first, last)
        except TimeoutError:
            return None
        inside = {name: _between(found, start, end) for name, found in samples.items()}
        times, step = _times(step, [time for time, _ in inside.values()])
        if len(times) <= points:
            values = {name: {"min": _plain(_placed(times, *found))} for name, found in inside.items()}
            return {"t": (times / 1e6).tolist(), "v": values, "step_ms": step / 1e6, "complete": True}
        grid = fitting(start, end, points, max(step, 1))
        if grid.start < first or grid.end > last:
            return None
        return {**_drawn(grid, {name: [_bucketed(grid, found)] for name, found in samples.items()}), "complete": True}

    def _samples(self, asked: _Asked, start: int, end: int) -> tuple[int, dict[str, Samples]]:
        """Step of the frames, 0 without any, and the samples of each channel from ``start`` to before ``end`` UTC ns.

        Raises ``TimeoutError`` where that takes too long, ``OSError`` where the disk cannot be read.
        """
        step, pace = 0, ends_at(asked.until)
        pieces: dict[str, list[Samples]] = {name: [] for name in asked.names}
        for kept in near(asked.recordings, start, end):
            # One that was removed meanwhile, or of which nothing can be read, has nothing to give.
            with suppress(FileNotFoundError, RecordingError):
                places = self.store.places(kept, pace)
                _, file = open_recording(kept.path)
                with file:
                    for items in places.items(file, CURVES, start, end):
                        for item in items:
                            step = max(step, item.layout.step) if isinstance(item, Frames) else step
                            columns, times, values = samples_of(item) or ((), (), ())
                            for name in pieces.keys() & set(columns):
                                pieces[name].append((times, values[:, columns.index(name)]))
                        pace()
        for name, held in asked.memory[1].items():
            pieces[name].append(held)
        return step or asked.memory[0], {name: _between(_in_order(found), start, end) for name, found in pieces.items()}

    # long spans -----------------------------------------------------------------------------------

    def _levels(self, asked: _Asked) -> dict[str, Any]:
        """Curves out of the level files; those that are missing are made, newest first, as far as there is time."""
        level, grid = chosen(asked.start, asked.end, asked.points)
        parts: dict[str, list[Buckets]] = {name: [] for name in asked.names}
        complete = True
        for kept in reversed(near(asked.recordings, grid.start, grid.end)):
            try:
                source = self.store.source(kept, asked.until)
                if source is not None and source.start < grid.end and source.end >= grid.start:
                    for name, buckets in source.levels(level, asked.names):
                        parts[name].append(coarser(buckets, grid.step // STEPS[level]))
            except TimeoutError:
                complete = False
            except FileNotFoundError:  # it went with its recording, or to keep to the budget
                complete = complete and not kept.path.exists()
            except ValueError as error:
                self.store.spoiled(kept, str(error))
                complete = False
        for name in parts.keys() & asked.memory[1].keys():
            parts[name].append(_bucketed(grid, asked.memory[1][name]))
        return {**_drawn(grid, parts), "complete": complete}


def _in_order(pieces: Sequence[Samples]) -> Samples:
    """Samples of one channel in order of time."""
    times = np.concatenate([np.empty(0, np.int64), *(time for time, _ in pieces)])
    values = np.concatenate([np.empty(0), *(values for _, values in pieces)])
    order = np.argsort(times, kind="stable")
    return times[order], values[order]


def _between(samples: Samples, start: int, end: int) -> Samples:
    """Samples in order, from ``start`` to before ``end`` UTC ns."""
    first, last = np.searchsorted(samples[0], (start, end)).tolist()
    return samples[0][first:last], samples[1][first:last]


def _bucketed(grid: Grid, samples: Samples) -> Buckets:
    """Buckets of a grid's step of the samples of one channel."""
    return of_samples(samples[0], samples[1][:, None], grid.step)


def _times(step: int, times: Sequence[NDArray[np.int64]]) -> tuple[NDArray[np.int64], int]:
    """All times of the samples, one more in each gap, and the usual step from one to the next, ns."""
    every = np.unique(np.concatenate([np.empty(0, np.int64), *times]))
    apart = np.diff(every)
    step = step or (round(float(np.median(apart))) if len(apart) else 0)
    gaps = every[:-1][apart > 1.5 * step] + step
    return np.sort(np.concatenate([every, gaps])), step


def _placed(times: NDArray[np.int64], at: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at some of the times, NaN at the others."""
    out = np.full(len(times), np.nan)
    out[np.searchsorted(times, at)] = values
    return out


def _drawn(grid: Grid, parts: Mapping[str, Sequence[Buckets]]) -> dict[str, Any]:
    times = (grid.first + np.arange(grid.count)) * grid.step
    values = {}
    for name, buckets in parts.items():
        low, high = significant(grid.extremes(buckets).astype(np.float64), EXACT)
        values[name] = {"min": _plain(low), "max": _plain(high)}
    return {"t": (times / 1e6).tolist(), "v": values, "step_ms": grid.step / 1e6}


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    """Values for JSON, None for what is no number."""
    plain: list[float | None] = np.where(np.isfinite(values), values, np.array(None)).tolist()
    return plain
