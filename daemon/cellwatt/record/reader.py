"""Reading recordings: the same items, in the same order and blocks, as they were recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Batch, Float, Nanoseconds, Qualities, Tick
from cellwatt.channel import Stream
from cellwatt.errors import RecordingError
from cellwatt.files import open_file
from cellwatt.frames import Frames
from cellwatt.record import decoder
from cellwatt.record.chunks import LARGEST_RECORD, open_chunk
from cellwatt.record.container import RECORD, Chunk
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import FRAME_TOPIC, Item, topic_of
from cellwatt.record.header import PART, Header
from cellwatt.record.messages import TOPICS, Health
from cellwatt.record.rows import FrameRows, SampleRows
from cellwatt.record.scan import Damage, read_at
from cellwatt.record.summary import Survey, survey
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task

RESULTS = (Interval, Task, Energy, Prediction, Alarm)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Samples:
    """All samples of one stream: arrays (n,) as in ``Batch``, ``values`` (n, channels).

    ``sequence`` and ``arrival`` are given for each sample; sequence numbers begin anew with each session.
    """

    source: str
    stream: Stream
    sequence: NDArray[np.int64]
    arrival: Nanoseconds
    time: Nanoseconds
    bound: Nanoseconds
    values: Float
    quality: Qualities
    device_time: Nanoseconds | None

    def __len__(self) -> int:
        return len(self.time)


class Recording:
    """One or more files of a cell, read as one.

    ``header`` is that of the first file; ``streams`` says what was recorded of each source; ``layout`` is
    that of the frames, ``None`` where there are none; ``start`` and ``end`` are the earliest and latest time
    in it, UTC ns. ``damage`` lists what could not be read; it grows as chunks are read. Damaged chunks are
    passed over; the rest is exact.
    """

    def __init__(self, files: Sequence[Survey], damage: Iterable[Damage] = ()) -> None:
        self._files = tuple(files)
        self._tracks = [tracks_of(file.contents.channels)[0] for file in self._files]
        self.damage: list[Damage] = [*damage, *(d for f in self._files for d in f.damage)]
        self.header: Header = self._files[0].header
        self.start = min(f.contents.start for f in self._files)
        self.end = max(f.contents.end for f in self._files)
        self.streams = self._streams()
        self.layout = next((t.rows.layout for t in self._all_tracks() if isinstance(t.rows, FrameRows)), None)

    @classmethod
    def open(cls, source: Path | Iterable[Path]) -> Recording:
        """A file, several, or all in a folder, in the order in which they were recorded.

        Files still open or left open are read up to their last whole chunk; copies of a file are read once.
        Raises ``RecordingError`` where there is no recording, or they are of several cells.
        """
        given = [source] if isinstance(source, Path) else list(source)
        paths = [p for path in given for p in (_in_folder(path) if path.is_dir() else [path])]
        if not paths:
            raise RecordingError(f"{', '.join(map(str, given))}: no recordings (*.mcap) there")
        surveys, damage = _survey_all(paths)
        cells = sorted({f.header.cell for f in surveys})
        if len(cells) > 1:
            raise RecordingError(f"recordings of several cells ({', '.join(cells)}): name the files of one")
        return cls(*_in_order(surveys, damage))

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files, in order."""
        return tuple(f.path for f in self._files)

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic (``/raw/<source>/<stream>``, ``/frame``, …), damaged ones included."""
        counts: Counter[str] = Counter()
        for file in self._files:
            for number, n in file.contents.counts.items():
                if number in file.contents.channels:
                    counts[file.contents.channels[number].topic] += n
        return dict(counts)

    def entries(self) -> Iterator[Batch | Tick]:
        """Batches and ticks exactly as they were recorded: what replay needs."""
        return self._of((Batch, Tick), lambda t: isinstance(t.rows, SampleRows) or t.kind is Tick)

    def batches(self, source: str, stream: str) -> Samples:
        """All samples of one stream. Raises ``RecordingError`` where there is no such stream."""
        declared = next((s for s in self.streams.get(source, ()) if s.name == stream), None)
        if declared is None:
            there = ", ".join(f"{name}/{s.name}" for name, streams in self.streams.items() for s in streams)
            raise RecordingError(f"no stream {source}/{stream} in this recording; there are: {there}")
        topic = topic_of(source, stream)
        return join(source, declared, list(self._of((Batch,), lambda t: t.topic == topic)))

    def frames(self) -> Iterator[Frames]:
        """Frames in the blocks in which they were recorded."""
        return self._of((Frames,), lambda t: t.topic == FRAME_TOPIC)

    def frames_table(self) -> Frames:
        """All frames in one block. Raises ``RecordingError`` where there are none, or the layout changes."""
        blocks = list(self.frames())
        if not blocks or self.layout is None:
            raise RecordingError("no frames in this recording; replay it to make them")
        if any(b.layout != self.layout for b in blocks):
            raise RecordingError("the layout of the frames changes within this recording: read its files one by one")
        return Frames(
            layout=self.layout,
            sequence=blocks[0].sequence,
            time=np.concatenate([b.time for b in blocks]),
            values=np.concatenate([b.values for b in blocks]),
            quality=np.concatenate([b.quality for b in blocks]),
            bound=np.concatenate([b.bound for b in blocks]),
        )

    def results(self) -> Iterator[Result]:
        """Intervals, tasks, energies, predictions and alarms in the order of their recording."""
        return self._of(RESULTS, lambda t: t.kind in RESULTS)

    def events(self) -> Iterator[Event]:
        """What happened to sources and the daemon."""
        return self._of((Event,), lambda t: t.topic == TOPICS[Event])

    def health(self) -> Iterator[Health]:
        """The daemon's health as it was published."""
        return self._of((Health,), lambda t: t.topic == TOPICS[Health])

    def _of(self, kinds: tuple[type[T], ...], wanted: Callable[[Track], bool]) -> Iterator[T]:
        for file, tracks in zip(self._files, self._tracks, strict=True):
            numbers = {number for number, track in tracks.items() if wanted(track)}
            if not numbers:
                continue
            for item in self._read(file, tracks, numbers):
                if isinstance(item, kinds):
                    yield item

    def _read(self, file: Survey, tracks: dict[int, Track], wanted: set[int]) -> Iterator[Item]:
        """The wanted items of a file; a chunk is decoded as a whole, so that a damaged one gives nothing."""
        chunks = file.contents.chunks or survey(file.path).contents.chunks
        try:
            with open_file(file.path) as opened:
                for chunk in chunks:
                    if chunk.indexes and not any(number in wanted for number, _ in chunk.indexes):
                        continue
                    try:
                        found = list(decoder.items(chunk_data(opened, chunk), tracks, wanted))
                    except ValueError as error:
                        self._note(Damage(file.path, chunk.offset, chunk.length, str(error)))
                        continue
                    yield from found
        except OSError as error:
            raise RecordingError(f"{file.path}: cannot be read: {error.strerror}") from error

    def _note(self, damage: Damage) -> None:
        if damage not in self.damage:
            self.damage.append(damage)

    def _all_tracks(self) -> Iterator[Track]:
        return (track for tracks in self._tracks for track in tracks.values())

    def _streams(self) -> dict[str, tuple[Stream, ...]]:
        found: dict[str, dict[str, Stream]] = {}
        for track in self._all_tracks():
            if isinstance(track.rows, SampleRows):
                found.setdefault(track.rows.source, {}).setdefault(track.rows.stream.name, track.rows.stream)
        return {source: tuple(streams.values()) for source, streams in sorted(found.items())}


def chunk_data(file: FileIO, chunk: Chunk) -> bytes:
    """The records of a chunk; raises ``ValueError`` where it is damaged."""
    if chunk.length > LARGEST_RECORD:
        raise ValueError("a chunk's length is wrong")
    return open_chunk(read_at(file, chunk.length, chunk.offset)[RECORD.size :]).data


def join(source: str, stream: Stream, batches: Sequence[Batch]) -> Samples:
    """Batches of one stream in one piece; device times only where every batch has them."""
    times = [b.device_time for b in batches if b.device_time is not None]
    no_time = np.empty(0, np.int64)
    return Samples(
        source=source,
        stream=stream,
        sequence=np.concatenate([no_time, *(np.arange(b.sequence, b.sequence + len(b)) for b in batches)]),
        arrival=np.concatenate([no_time, *(np.full(len(b), b.arrival) for b in batches)]),
        time=np.concatenate([no_time, *(b.time for b in batches)]),
        bound=np.concatenate([no_time, *(b.bound for b in batches)]),
        values=np.concatenate([np.empty((0, len(stream.channels))), *(b.values for b in batches)]),
        quality=np.concatenate([np.empty(0, np.uint8), *(b.quality for b in batches)]),
        device_time=np.concatenate(times) if times and len(times) == len(batches) else None,
    )


def _in_folder(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.name.endswith((".mcap", f".mcap{PART}")))


def _survey_all(paths: Iterable[Path]) -> tuple[list[Survey], list[Damage]]:
    """What can be read; a file that holds nothing readable is damage where others do, an error where none does."""
    surveys, damage, errors = [], [], []
    for path in paths:
        try:
            surveys.append(survey(path, chunks=False))
        except RecordingError as error:
            errors.append(error)
            damage.append(Damage(path, 0, path.stat().st_size if path.exists() else 0, "nothing in it can be read"))
    if not surveys:
        raise errors[0]
    return surveys, damage


def _in_order(surveys: Sequence[Survey], damage: list[Damage]) -> tuple[list[Survey], list[Damage]]:
    """Files by session and number; of copies, the one that holds most."""
    kept: dict[tuple[int, ...], Survey] = {}
    for file in sorted(surveys, key=lambda f: (-f.contents.counts.total(), f.path.name)):
        header, contents = file.header, file.contents
        same = (header.session, header.number) if header.number else (header.session, 0, contents.start, contents.end)
        first = kept.setdefault(same, file)
        if first is not file:
            damage.append(Damage(file.path, 0, 0, f"is a copy of {first.path.name}, not read again"))
    filled = [f for f in kept.values() if f.contents.counts] or list(kept.values())[:1]
    return sorted(filled, key=lambda f: (f.header.session, f.header.number, f.contents.start)), damage
