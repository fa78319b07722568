"""Short spans: the frames and predictions themselves, out of the chunks that overlap."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.following import items_at
from cellwatt.outlets.page.levels.gathering import CURVES, Columns, prediction_arrays, prediction_names
from cellwatt.outlets.page.levels.store import Store
from cellwatt.record.encoder import Item
from cellwatt.record.folder import RecordFile
from cellwatt.record.survey import open_recording
from cellwatt.results import Prediction

Samples = tuple[NDArray[np.int64], NDArray[np.float64]]


@dataclass
class Moments:
    """Samples of channels in a span, in pieces: times (n,) UTC ns and values (n,); ``step`` ns of frames, if any."""

    start: int
    end: int
    pieces: Mapping[str, list[Samples]]
    step: int = 0

    def add(self, item: Item) -> None:
        """Take what is wanted of an item."""
        if isinstance(item, Frames):
            self.step = max(self.step, item.layout.step)
            self._take(item.layout.names, item.time, item.values)
        elif isinstance(item, Prediction):
            self._take(prediction_names(item), *prediction_arrays(item))

    def of(self, channel: str, start: int, end: int) -> Samples:
        """Samples of a channel from ``start`` to before ``end`` UTC ns, in order of time."""
        pieces = self.pieces[channel]
        times = np.concatenate([np.empty(0, np.int64), *(time for time, _ in pieces)])
        values = np.concatenate([np.empty(0), *(values for _, values in pieces)])
        order = np.argsort(times, kind="stable")
        times, values = times[order], values[order]
        first, last = np.searchsorted(times, (start, end)).tolist()
        return times[first:last], values[first:last]

    def _take(self, columns: Columns, times: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        inside = (times >= self.start) & (times < self.end)
        if not inside.any():
            return
        times = times[inside]
        for place, name in enumerate(columns):
            if name in self.pieces:
                self.pieces[name].append((times, values[inside, place]))


def read(
    store: Store, recordings: Iterable[RecordFile], start: int, end: int, channels: Sequence[str], until: float
) -> Moments:
    """Samples from ``start`` to before ``end`` UTC ns, out of a store's recordings.

    Raises ``TimeoutError`` at monotonic time ``until``, ``OSError`` where the disk cannot be read.
    """
    found = Moments(start, end, {name: [] for name in channels})
    for kept in recordings:
        levels = store.known(kept) if kept.closed else None
        if levels is not None and (levels.end < start or levels.start >= end):
            continue
        # One that was removed meanwhile, or of which nothing can be read, has nothing to give.
        with suppress(FileNotFoundError, RecordingError):
            places, tracks = store.chunks(kept, until)
            wanted = frozenset(number for number, track in tracks.items() if track.topic in CURVES)
            _, file = open_recording(kept.path)
            with file:
                for offset, length, first, last in places:
                    if first >= end or last < start:
                        continue
                    with suppress(ValueError):  # a chunk that is damaged has nothing to give
                        for item in items_at(file, offset, length, tracks, wanted):
                            found.add(item)
                    if time.monotonic() > until:
                        raise TimeoutError
    return found
