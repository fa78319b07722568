"""Reads recordings: the same items, in the same order and blocks, as they were recorded."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from copy import copy
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, get_args, overload

import numpy as np

from cellwatt.batch import Batch, Tick
from cellwatt.errors import RecordingError
from cellwatt.files import Places, paths_of
from cellwatt.frames import Frames, concatenate, cut
from cellwatt.progress import aside, steps
from cellwatt.record import decoder
from cellwatt.record.chunks import chunk_data
from cellwatt.record.container import Chunk
from cellwatt.record.decoder import Track, streams_of, tracks_of
from cellwatt.record.encoder import FRAME_TOPIC, Item, topic_of
from cellwatt.record.header import PART, Header
from cellwatt.record.messages import TOPICS, Health, time_of
from cellwatt.record.rows import FrameRows, SampleRows
from cellwatt.record.samples import Samples, join, unchanged
from cellwatt.record.scan import Damage
from cellwatt.record.survey import (
    Survey,
    files_at,
    identity_of,
    in_order,
    open_recording,
    open_until,
    removed,
    survey_all,
    survey_open,
)
from cellwatt.results import Alarm, Event, Interval, Result, Task

if TYPE_CHECKING:
    from cellwatt.record.tables import Library

log = logging.getLogger(__name__)

EVER = 2**62
"""Later than any time in a recording, UTC ns."""

T = TypeVar("T")


class Recording:
    """One or more files of a cell, read as one.

    ``header`` is that of the first file; ``streams`` are the recorded streams by source; ``layout`` is
    that of the frames, ``None`` without frames; ``start`` and ``end`` are the earliest and latest time
    in it, UTC ns. ``damage`` lists the parts that could not be read; it grows as chunks are read. Damaged chunks are
    skipped; the others are exact. Files are open only while they are read.

    The recording of a running cell ends with the last chunk that was whole when the recording was opened, however
    often it is read: ``unfinished`` names these files. Files that retention removes before they are read are listed
    in ``damage``. Both are logged as warnings.
    """

    def __init__(self, files: Sequence[Survey], damage: Iterable[Damage] = ()) -> None:
        self._files = tuple(files)
        self._tracks = [tracks_of(file.contents.channels)[0] for file in self._files]
        self.damage: list[Damage] = [*damage, *(d for f in self._files for d in f.damage)]
        self.header: Header = self._files[0].header
        self.start = min(f.contents.start for f in self._files)
        self.end = max(f.contents.end for f in self._files)
        self.streams = streams_of(self._all_tracks())
        self._unfinished = [f for f in self._files if not f.closed and f.path.name.endswith(PART)]
        self._span: tuple[int, int] | None = None
        self.keeps: object = None
        """An object that must live as long as the recording or a copy of it: the owner of temporary files."""
        self.layout = next((t.rows.layout for t in self._all_tracks() if isinstance(t.rows, FrameRows)), None)

    @classmethod
    def open(cls, source: Places) -> Recording:
        """Open a file, several, or all in a folder, in the order in which they were recorded.

        Files still being written or left open are read up to their last whole chunk; copies of a file are read once.
        Raises ``RecordingError`` if there is no recording, or the recordings are of several cells.
        """
        surveys, damage = survey_all(files_at(paths_of(source)))
        cells = sorted({f.header.cell for f in surveys})
        if len(cells) > 1:
            raise RecordingError(f"recordings of several cells ({', '.join(cells)}): name the files of one")
        recording = cls(*in_order(surveys, damage))
        for warning in (*map(open_until, recording._unfinished), *recording.damage):
            log.warning("%s", warning)
        return recording

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files, in order."""
        return tuple(f.path for f in self._files)

    @property
    def spans(self) -> tuple[tuple[Header, int, int], ...]:
        """Header, earliest and latest time (UTC ns) of each file, in order."""
        return tuple((f.header, f.contents.start, f.contents.end) for f in self._files)

    @property
    def unfinished(self) -> tuple[Path, ...]:
        """The files that were not closed when they were opened."""
        return tuple(f.path for f in self._unfinished)

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the sources with raw samples."""
        return tuple(self.streams)

    @property
    def channels(self) -> dict[str, str]:
        """Unit by channel (``source.channel``): of the frames, or of the raw streams if there are no frames."""
        if self.layout is not None:
            return {c.name: c.unit for c in self.layout.channels}
        raw = ((source, c) for source, streams in self.streams.items() for s in streams for c in s.channels)
        return {f"{source}.{c.name}": c.unit for source, c in raw}

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic (``/raw/<source>/<stream>``, ``/frame``, …), damaged ones included."""
        counts: Counter[str] = Counter()
        for file in self._files:
            counts.update(file.contents.by_topic())
        return dict(counts)

    def entries(self) -> Iterator[Batch | Tick]:
        """Batches and ticks exactly as they were recorded: what replay needs."""
        return self._of((Batch, Tick), lambda t: isinstance(t.rows, SampleRows) or t.kind is Tick)

    def items(self) -> Iterator[tuple[Header, Item]]:
        """All items as they were recorded, each with the header of its file."""
        for file, tracks in zip(self._files, self._tracks, strict=True):
            for item in self._of_file(file, tracks, set(tracks)):
                yield file.header, item

    def batches(self, source: str, stream: str) -> Samples:
        """All samples of one stream. Raises ``RecordingError`` for an unknown stream, or if its channels change."""
        declared = next((s for s in self.streams.get(source, ()) if s.name == stream), None)
        if declared is None:
            there = ", ".join(f"{name}/{s.name}" for name, streams in self.streams.items() for s in streams)
            raise RecordingError(f"no stream {source}/{stream} in this recording; there are: {there}")
        topic = topic_of(source, stream)
        batches = self._of((Batch,), lambda t: t.topic == topic)
        return join(source, declared, list(unchanged(batches, self.streams, "read them one by one")))

    def frames(self) -> Iterator[Frames]:
        """Frames in the blocks in which they were recorded."""
        return self._of((Frames,), lambda t: t.topic == FRAME_TOPIC)

    def frames_table(self) -> Frames:
        """All frames in one block. Raises ``RecordingError`` if there are none, or the layout changes."""
        blocks = list(self.frames())
        if not blocks or self.layout is None:
            raise self.lacks_frames()
        if any(b.layout != self.layout for b in blocks):
            raise RecordingError("the layout of the frames changes within this recording: read its files one by one")
        return concatenate(blocks)

    @property
    def has_samples(self) -> bool:
        """True if samples of a source were recorded."""
        return any(count for topic, count in self.counts.items() if topic.startswith(topic_of("", "")[:-1]))

    def lacks_frames(self) -> RecordingError:
        """Return the error for a recording without frames: what it holds, and how to use it."""
        there = ", ".join(f"{topic} ({count})" for topic, count in sorted(self.counts.items()) if count)
        name = self.paths[0].name if len(self.paths) == 1 else f"{self.paths[0].name} and {len(self.paths) - 1} more"
        if self.has_samples:
            return RecordingError(
                f"{name}: no frames in this recording, only samples: cellwatt export --raw writes them as tables "
                f"(it has {there})"
            )
        return RecordingError(f"{name}: neither frames nor samples in this recording; it has {there or 'no messages'}")

    @overload
    def results(self) -> Iterator[Result]: ...
    @overload
    def results(self, kind: type[T]) -> Iterator[T]: ...
    def results(self, kind: type[Any] | None = None) -> Iterator[Any]:
        """Intervals, tasks, energies, predictions and alarms, or only those of ``kind``, in recorded order."""
        kinds = get_args(Result) if kind is None else (kind,)
        return self._of(kinds, lambda t: t.kind in kinds)

    def intervals(self) -> list[Interval]:
        """All closed intervals."""
        return [i for i in self.results(Interval) if i.closed]

    def tasks(self) -> list[Task]:
        """All recognised tasks."""
        return list(self.results(Task))

    def alarms(self) -> list[Alarm]:
        """All messages of alarms: raised, updated and cleared."""
        return list(self.results(Alarm))

    def events(self) -> Iterator[Event]:
        """Events of sources and the daemon."""
        return self._of((Event,), lambda t: t.topic == TOPICS[Event])

    def health(self) -> Iterator[Health]:
        """The daemon's health as it was published."""
        return self._of((Health,), lambda t: t.topic == TOPICS[Health])

    def within(self, start: float | None = None, end: float | None = None) -> Recording:
        """The same recording restricted to ``start`` … ``end``, s since ``self.start``, both included.

        ``streams``, ``counts``, ``start`` and ``end`` remain those of the whole recording.
        """
        first, last = (self.start + round(t * 1e9) if t is not None else None for t in (start, end))
        return self.between(-EVER if first is None else first, EVER if last is None else last)

    def between(self, start: int, end: int) -> Recording:
        """As ``within``, with ``start`` and ``end`` in UTC ns."""
        out = copy(self)
        out._span = (start, end)
        return out

    def frame(
        self,
        start: float | None = None,
        end: float | None = None,
        channels: str | Sequence[str] | None = None,
        *,
        quality: bool = False,
        library: Library | None = None,
    ) -> Any:
        """Frames as a data frame: ``t`` (s since ``self.start``), ``utc_ns``, one column a channel in its SI unit.

        ``start`` and ``end`` as for ``within``. ``channels`` are full names, short names that only one source has, or
        patterns (``*.position``). ``quality`` adds ``<channel>.quality`` (0 good to 4 missing) and
        ``<channel>.bound_ns``. ``library`` is ``pandas``, ``polars`` or ``arrow``; by default the first of them that
        is installed. Units are in ``attrs["units"]`` (pandas) or in the fields' metadata (Arrow).

        Raises ``RecordingError`` as ``frames_table``, ``ConfigError`` for an unknown channel,
        ``CellwattError`` if ``library`` is not installed.
        """
        # pyarrow is large, and the daemon's processes that read recordings do not need it.
        from cellwatt.record.tables import data_frame, frame_rows, of_channels

        frames = self.within(start, end).frames_table()
        if channels is not None:
            frames = of_channels(frames, [channels] if isinstance(channels, str) else channels)
        return data_frame(frame_rows(frames, self.start, known=quality), self.header, self.start, library)

    def raw(
        self, stream: str, start: float | None = None, end: float | None = None, *, library: Library | None = None
    ) -> Any:
        """Samples of a stream (``source/stream``) as a data frame, with the columns of ``cellwatt export``.

        ``start``, ``end`` and ``library`` as for ``frame``. Raises ``RecordingError`` as ``batches``.
        """
        from cellwatt.record.tables import data_frame, sample_rows

        samples = self.within(start, end).batches(*stream.partition("/")[::2])
        return data_frame(sample_rows(samples, self.start), self.header, self.start, library)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: no file is open between two reads."""

    def _of(self, kinds: tuple[type[T], ...], wanted: Callable[[Track], bool]) -> Iterator[T]:
        for file, tracks in steps(list(zip(self._files, self._tracks, strict=True)), "reading file"):
            numbers = {number for number, track in tracks.items() if wanted(track)}
            yield from (item for item in self._of_file(file, tracks, numbers) if isinstance(item, kinds))

    def _of_file(self, file: Survey, tracks: dict[int, Track], numbers: set[int]) -> Iterator[Item]:
        """The items of the channels ``numbers`` of a file that are within the span."""
        contents, span = file.contents, self._span
        if not numbers or (span is not None and (contents.start > span[1] or contents.end < span[0])):
            return
        for item in self._read(file, tracks, numbers):
            if (inside := item if span is None else _within(item, span)) is not None:
                yield inside

    def _read(self, file: Survey, tracks: dict[int, Track], wanted: set[int]) -> Iterator[Item]:
        """The wanted items of a file; a chunk is decoded as a whole, so that a damaged chunk yields no items."""
        span = self._span
        try:
            path, opened = open_recording(file.path)
        except FileNotFoundError:
            self._note(removed(file))
            return
        except OSError as error:
            raise RecordingError(f"{file.path}: cannot be read: {error.strerror}") from error
        with opened:
            now = file
            if not file.contents.chunks or identity_of(opened) != file.identity:  # the latter: repaired meanwhile
                now = survey_open(opened, path)
            for chunk in steps(now.contents.chunks, "part"):
                if span is not None and (chunk.start > span[1] or chunk.end < span[0]):
                    continue
                if chunk.indexes and not any(number in wanted for number, _ in chunk.indexes):
                    continue
                try:
                    found = numbered_items(opened, chunk, tracks, wanted)
                except ValueError as error:
                    self._note(Damage(file.path, chunk.offset, chunk.length, str(error)))
                    continue
                yield from (item for _, item in found)

    def _note(self, damage: Damage) -> None:
        if damage not in self.damage:
            self.damage.append(damage)
            with aside():
                log.warning("%s", damage)

    def _all_tracks(self) -> Iterator[Track]:
        return (track for tracks in self._tracks for track in tracks.values())


def numbered_items(
    file: FileIO, chunk: Chunk, tracks: Mapping[int, Track], wanted: Container[int]
) -> list[tuple[int, Item]]:
    """The wanted items of a chunk with their numbers. Raises ``ValueError`` if it is damaged."""
    return list(decoder.numbered(chunk_data(file, chunk), tracks, wanted))


def _within(item: Any, span: tuple[int, int]) -> Any:
    """An item, or the rows of a block, whose time (UTC ns) is in ``span``; None if there are none."""
    if not isinstance(item, Batch | Frames):
        return item if span[0] <= time_of(item) <= span[1] else None
    first, last = np.searchsorted(item.time, (span[0], span[1] + 1)).tolist()
    return cut(item, first, last) if first < last else None
