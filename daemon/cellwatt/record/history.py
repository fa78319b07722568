"""Answers about the past while recording goes on: what a subscriber missed, and which files there are."""

from __future__ import annotations

import os
import sys
import threading
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import FileIO
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, Generic, TypeVar

from cellwatt.batch import Batch
from cellwatt.errors import RecordingError, RepairingError
from cellwatt.files import open_file
from cellwatt.frames import Frames, cut
from cellwatt.record import decoder, seal
from cellwatt.record.container import Chunk, Chunks, Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import FRAME_TOPIC, topic_of
from cellwatt.record.folder import RecordFile, listing
from cellwatt.record.reader import chunk_data, numbered_items
from cellwatt.record.survey import Survey, read_summary, survey
from cellwatt.record.writer import Recorder
from cellwatt.results import Event, Result

FLUSH_TIMEOUT = 1.0
"""Longest wait for the newest samples to reach the file, s."""
ATTEMPTS = 5
"""Repetitions of a search if the files change under it."""
CACHED_FILES = 2
"""Files whose list of chunks is kept in memory."""


@dataclass(frozen=True, slots=True)
class FileIndex:
    """Index of a file: ``firsts`` maps topics and series to their channel and first sequence number."""

    kept: RecordFile
    state: str
    start: int
    end: int
    messages: int
    firsts: Mapping[str, tuple[int, int]]
    seal: Mapping[str, Any] | None = None
    """Signature of the cell for it, see ``record.seal``."""


def tracks_in(contents: Contents) -> dict[int, Track]:
    """Readers of the channels; another thread may define more meanwhile."""
    return tracks_of(dict(contents.channels))[0]


def look_at(kept: RecordFile) -> FileIndex:
    """Read what a file says of itself; one that its writer left open waits for its repair."""
    nothing = FileIndex(kept, "unreadable", 0, 0, 0, {})
    try:
        if kept.path.suffix == ".mcap":
            found: Survey = survey(kept.path, chunks=False)
            known = index_of(kept, found.contents, "closed" if not found.damage and found.closed else "damaged")
            return replace(known, seal=seal.read(kept.path))
        if not kept.closed:
            with open_file(kept.path) as file:
                summary = read_summary(file, chunks=False)
            return index_of(kept, summary, "closing") if summary else FileIndex(kept, "left open", 0, 0, 0, {})
    except (OSError, ValueError, RecordingError):
        pass
    return nothing


def index_of(kept: RecordFile, contents: Contents, state: str) -> FileIndex:
    """The index of a file from its contents."""
    firsts = {t.series: (number, t.first) for number, t in tracks_in(contents).items() if t.series is not None}
    return FileIndex(kept, state, contents.start, contents.end, sum(dict(contents.counts).values()), firsts)


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Numbered:
    """A result or event with its number: a block of one."""

    sequence: int
    item: Result | Event

    def __len__(self) -> int:
        return 1


Block = TypeVar("Block", bound=Batch | Frames | _Numbered)


@dataclass(frozen=True, slots=True)
class _Topic(Generic[Block]):
    """A topic or series and the kind of the blocks that are filed under it."""

    name: str
    kind: type[Block]


_FRAMES = _Topic(FRAME_TOPIC, Frames)


class History:
    """Serves what is in ``folder`` of the recorder's cell, and the file it is writing. Any thread may ask."""

    def __init__(self, folder: Path, recorder: Recorder) -> None:
        self._folder = folder
        self._recorder = recorder
        self._lock = threading.Lock()
        self._known: dict[Path, FileIndex] = {}
        self._chunks: OrderedDict[Path, tuple[Chunks, dict[int, Track]]] = OrderedDict()

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> list[Batch]:
        """Recorded samples ``first`` … ``first + count`` of a stream, in order.

        If none is left of them, the first ``count`` after them.

        Reads files and may wait for a flush: never call it on the event loop. Raises ``RepairingError``.
        """
        return self._asked(_Topic(topic_of(source, stream), Batch), session, first, count)

    def frames(self, session: int, first: int, count: int) -> list[Frames]:
        """Recorded frames, as ``history``."""
        return self._asked(_FRAMES, session, first, count)

    def results(self, series: str, session: int, first: int, count: int) -> list[tuple[int, Result | Event]]:
        """Recorded results or events of a series with their numbers, as ``history``."""
        return [(each.sequence, each.item) for each in self._asked(_Topic(series, _Numbered), session, first, count)]

    def recordings(self) -> list[dict[str, Any]]:
        """The files kept, oldest first: file, session, start, end (UTC ns), bytes, messages, state; JSON-ready."""
        with self._lock:
            return [
                {
                    "file": known.kept.path.name,
                    "session": known.kept.name.session,
                    "start": known.start,
                    "end": known.end,
                    "bytes": known.kept.size,
                    "messages": known.messages,
                    "state": known.state,
                    **({} if known.seal is None else {"seal": known.seal}),
                }
                for known in self._settled(self._files)
            ]

    def _asked(self, topic: _Topic[Block], session: int, first: int, count: int) -> list[Block]:
        repairing = self._recorder.repairing(session)
        with self._lock:
            found = self._settled(lambda: self._find(topic, session, first, count))
            if _end(found, first) < first + count and self._recorder.flush(FLUSH_TIMEOUT):
                found = self._settled(lambda: self._find(topic, session, first, count))
        if repairing and (not found or found[0].sequence > first):
            raise RepairingError(f"what was recorded from {first} on is being repaired: ask again in a while")
        return found

    def _files(self) -> list[FileIndex]:
        """All files of the cell in order, read again only where they changed."""
        live = self._recorder.live()
        fresh: dict[Path, FileIndex] = {}
        for kept in listing(self._folder, self._recorder.cell):
            old = self._known.get(kept.path)
            if live is not None and kept.path == live[0]:
                fresh[kept.path] = index_of(kept, live[1], "open")
            elif old is not None and old.state != "open" and old.kept == kept:
                fresh[kept.path] = old
            else:
                fresh[kept.path] = look_at(kept)
        self._known = fresh
        return list(fresh.values())

    def _settled(self, look: Callable[[], T]) -> T:
        """Look, and again where files were closed, renamed or removed meanwhile."""
        for _ in range(ATTEMPTS):
            before = self._names()
            found = look()
            if self._names() == before:
                break
        return found

    def _names(self) -> list[str]:
        try:
            with os.scandir(self._folder) as entries:  # without the state of each: a folder of weeks has many
                return sorted(entry.name for entry in entries)
        except FileNotFoundError:
            return []

    def _find(self, topic: _Topic[Block], session: int, first: int, count: int) -> list[Block]:
        """What is left of what is asked for; if nothing is, as many rows of those after it."""
        files = [f for f in self._files() if f.kept.name.session == session and topic.name in f.firsts]
        files = files[max(bisect_right(files, first, key=lambda f: f.firsts[topic.name][1]) - 1, 0) :]
        if found := self._from_files(files, topic, first, first + count):
            return found
        later = next(filter(None, (self._from_file(f, topic, first, sys.maxsize, 1) for f in files)), None)
        return self._from_files(files, topic, later[0].sequence, later[0].sequence + count) if later else []

    def _from_files(self, files: list[FileIndex], topic: _Topic[Block], first: int, stop: int) -> list[Block]:
        within = takewhile(lambda f: f.firsts[topic.name][1] < stop, files)
        return [block for known in within for block in self._from_file(known, topic, first, stop)]

    def _from_file(
        self, known: FileIndex, topic: _Topic[Block], first: int, stop: int, most: int | None = None
    ) -> list[Block]:
        channel = known.firsts[topic.name][0]
        try:
            chunks, tracks = self._listed(known)
            with open_file(known.kept.path) as file:
                holding = chunks.holding(channel)
                places = range(len(holding))
                start = bisect_right(places, first, key=lambda i: _first_from(file, holding, i, tracks, channel))
                blocks = _blocks(file, _from(holding, max(start - 1, 0)), tracks, channel, topic.kind)
                return list(islice(_between(blocks, first, stop), most))
        except (OSError, RecordingError):
            # Renamed, which is noticed and tried again, or removed to make room: what is left is asked for.
            return []

    def _listed(self, known: FileIndex) -> tuple[Chunks, dict[int, Track]]:
        """Chunks and tracks of a file; of closed ones the last few are kept."""
        path = known.kept.path
        live = self._recorder.live()
        if live is not None and path == live[0]:
            return live[1].chunks, tracks_in(live[1])
        if path not in self._chunks:
            contents = survey(path).contents
            self._chunks[path] = contents.chunks, tracks_in(contents)
            while len(self._chunks) > CACHED_FILES:
                self._chunks.popitem(last=False)
        self._chunks.move_to_end(path)
        return self._chunks[path]


def _end(blocks: Sequence[Batch | Frames | _Numbered], first: int) -> int:
    return blocks[-1].sequence + len(blocks[-1]) if blocks else first


def _blocks(
    file: FileIO, chunks: Iterable[Chunk], tracks: Mapping[int, Track], channel: int, kind: type[Block]
) -> Iterator[Block]:
    """The blocks of one topic in some chunks; of a damaged chunk none."""
    for chunk in chunks:
        try:
            found = numbered_items(file, chunk, tracks, {channel})
        except ValueError:
            continue
        blocks = (_Numbered(n, item) if isinstance(item, Result | Event) else item for n, item in found)
        yield from (block for block in blocks if isinstance(block, kind))


def _first_from(file: FileIO, chunks: Sequence[Chunk], at: int, tracks: Mapping[int, Track], channel: int) -> int:
    """The sequence number with which a topic goes on in the first chunk from ``at`` on that can be read."""
    for chunk in _from(chunks, at):
        try:
            for number, _ in decoder.numbered(chunk_data(file, chunk), tracks, {channel}):
                return number
        except ValueError:
            continue
    return sys.maxsize


def _from(chunks: Sequence[Chunk], at: int) -> Iterator[Chunk]:
    """Those from ``at`` on, each made when it is needed: a slice would make them all."""
    return (chunks[place] for place in range(at, len(chunks)))


def _between(blocks: Iterable[Block], first: int, stop: int) -> Iterator[Block]:
    for block in blocks:
        if block.sequence >= stop:
            return
        part = trim(block, first, stop)
        if part is not None:
            yield part


def trim(block: Block, first: int, stop: int) -> Block | None:
    """The part of a block with sequence numbers from ``first`` to before ``stop``."""
    low, high = max(first - block.sequence, 0), min(stop - block.sequence, len(block))
    if low >= high:
        return None
    return block if isinstance(block, _Numbered) else cut(block, low, high)
