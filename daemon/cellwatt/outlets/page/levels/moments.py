"""Short spans: the frames and predictions themselves, out of the chunks that overlap."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.following import Places, items_at
from cellwatt.outlets.page.levels.gathering import CURVES, Columns, prediction_arrays, prediction_names
from cellwatt.outlets.page.levels.store import Store
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import Item
from cellwatt.record.opening import open_recording, survey
from cellwatt.record.retention import Kept
from cellwatt.results import Prediction

LISTED: Final = 3
"""Closed recordings whose list of chunks is kept in memory."""

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


class Reader:
    """Reads moments out of a store's recordings. Any thread may ask."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._listed: OrderedDict[Path, tuple[int, Places, Mapping[int, Track]]] = OrderedDict()

    def read(self, recordings: Iterable[Kept], start: int, end: int, channels: Sequence[str], until: float) -> Moments:
        """Samples from ``start`` to before ``end`` UTC ns.

        Raises ``TimeoutError`` at monotonic time ``until``, ``OSError`` where the disk cannot be read.
        """
        found = Moments(start, end, {name: [] for name in channels})
        for kept in recordings:
            if self._lies_elsewhere(kept, start, end):
                continue
            # One that was removed meanwhile, or of which nothing can be read, has nothing to give.
            with suppress(FileNotFoundError, RecordingError):
                places, tracks = self._chunks(kept, until)
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

    def _lies_elsewhere(self, kept: Kept, start: int, end: int) -> bool:
        """True where the level file says that nothing of a span is in a recording."""
        source = self._store.known(kept) if kept.closed else None
        return source is not None and (source.end < start or source.start >= end)

    def _chunks(self, kept: Kept, until: float) -> tuple[Places, Mapping[int, Track]]:
        """The chunks, and the readers of their channels."""
        if not kept.closed:
            growing = self._store.growing(kept)
            with growing.lock:
                if not growing.grow(until):
                    raise TimeoutError
                return list(growing.places), growing.tracks
        with self._lock:
            size, places, tracks = self._listed.get(kept.path, (0, None, {}))
            if places is None or size != kept.size:
                contents = survey(kept.path).contents
                places = [(c.offset, c.length, c.start, c.end) for c in contents.chunks]
                tracks = tracks_of(contents.channels)[0]
                self._listed[kept.path] = (kept.size, places, tracks)
                while len(self._listed) > LISTED:
                    self._listed.popitem(last=False)
            self._listed.move_to_end(kept.path)
            return places, tracks
