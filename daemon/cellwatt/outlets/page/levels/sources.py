"""Knowledge of one recording: from its level file, or in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from cellwatt.files import open_file
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, coarser
from cellwatt.outlets.page.levels.following import chunk_at
from cellwatt.outlets.page.levels.gathering import CURVES, TELLING, Columns, Gathering, Intervals
from cellwatt.outlets.page.levels.level_file import LevelFile
from cellwatt.record import decoder
from cellwatt.record.container import Chunk, Contents
from cellwatt.record.decoder import tracks_of
from cellwatt.record.encoder import Item
from cellwatt.record.opening import survey

EVERYTHING: Final = CURVES | TELLING
Pace = Callable[[], None]
"""Called after each chunk: may sleep, or raise to stop."""


class Written:
    """A recording whose level file is there; raises as ``LevelFile``."""

    def __init__(self, recording: Path, size: int) -> None:
        self._file = LevelFile(recording, size)
        self.start, self.end = self._file.head.start, self._file.head.end
        self.said = self._file.head.said
        self.intervals = self._file.intervals
        self.levels = self._file.levels


class Held:
    """A recording as far as it was gathered, with ``curves`` or without; later items change nothing."""

    def __init__(self, gathered: Gathering, *, curves: bool = True) -> None:
        self.start, self.end = gathered.start, gathered.end
        self.said = gathered.said
        self._intervals = gathered.intervals
        self._finest = gathered.finest() if curves else {}

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(buckets.size for buckets in self._finest.values()) + self._intervals.spans.nbytes

    def intervals(self) -> Intervals:
        """Intervals."""
        return self._intervals

    def levels(self, level: int, wanted: Sequence[str]) -> list[tuple[Columns, Buckets]]:
        """Buckets of one of ``STEPS`` of all sets of channels in which one of ``wanted`` is."""
        factor = STEPS[level] // STEPS[0]
        return [
            (columns, coarser(finest, factor) if level else finest)
            for columns, finest in self._finest.items()
            if not set(wanted).isdisjoint(columns)
        ]


Source = Written | Held
"""Levels, intervals and alarms of one recording, which reaches from ``start`` to ``end`` UTC ns."""


def gather(path: Path, topics: frozenset[str], pace: Pace) -> Gathering:
    """Read some topics of a closed recording; chunks that are damaged are passed over.

    Raises ``OSError``, and ``RecordingError`` where it cannot be read.
    """
    gathered = Gathering()
    contents = survey(path).contents
    tracks = tracks_of(contents.channels)[0]
    wanted = frozenset(number for number, track in tracks.items() if track.topic in topics)
    with open_file(path) as file:
        for chunk in _holding(contents, wanted):
            with suppress(ValueError):
                for item in _items(chunk_at(file, chunk.offset, chunk.length), tracks, wanted):
                    gathered.add(item)
            pace()
    return gathered


def _holding(contents: Contents, wanted: frozenset[int]) -> list[Chunk]:
    """The chunks with messages of some channels, in order, each once."""
    chunks = {chunk.offset: chunk for number in wanted for chunk in contents.chunks.holding(number)}
    return [chunks[offset] for offset in sorted(chunks)]


def _items(data: bytes, tracks: dict[int, decoder.Track], wanted: frozenset[int]) -> list[Item]:
    return list(decoder.items(data, tracks, wanted))
