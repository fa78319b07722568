"""Answers about the past during recording: rows that a subscriber missed, and the list of files."""

from __future__ import annotations

import sys
import threading
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from itertools import takewhile
from pathlib import Path
from typing import Any

from cellwatt.batch import Batch
from cellwatt.errors import RecordingError, RepairingError
from cellwatt.frames import Frames, cut
from cellwatt.record.chunks import read_summary
from cellwatt.record.container import Chunks, Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import FRAME_TOPIC, Item, topic_of
from cellwatt.record.folder import RecordFile, listing
from cellwatt.record.reader import numbered_items
from cellwatt.record.survey import Survey, open_recording, survey
from cellwatt.record.writer import Recorder
from cellwatt.results import Event, Result

FLUSH_TIMEOUT = 1.0
"""Longest wait for the newest samples to reach the file, s."""
CACHED_FILES = 2
"""Number of files whose list of chunks is cached."""


@dataclass(frozen=True, slots=True)
class FileIndex:
    """Index of a file: ``firsts`` maps topics and series to their channel and first sequence number."""

    stored: RecordFile
    state: str
    start: int
    end: int
    messages: int
    firsts: Mapping[str, tuple[int, int]]


def tracks_in(contents: Contents) -> dict[int, Track]:
    """Readers of the channels; another thread may define more channels meanwhile."""
    return tracks_of(dict(contents.channels))[0]


def look_at(stored: RecordFile) -> FileIndex:
    """Index of a file on disk; a file that its writer left open is not read before its repair."""
    try:
        if stored.path.suffix == ".mcap":
            found: Survey = survey(stored.path, chunks=False)
            return index_of(stored, found.contents, "closed" if not found.damage and found.closed else "damaged")
        if not stored.closed:
            with open_recording(stored.path)[1] as file:
                summary = read_summary(file, chunks=False)
            return index_of(stored, summary, "closing") if summary else FileIndex(stored, "left open", 0, 0, 0, {})
    except (OSError, ValueError, RecordingError):
        pass
    return FileIndex(stored, "unreadable", 0, 0, 0, {})


def index_of(stored: RecordFile, contents: Contents, state: str) -> FileIndex:
    """The index of a file from its contents."""
    firsts = {t.series: (number, t.first) for number, t in tracks_in(contents).items() if t.series is not None}
    return FileIndex(stored, state, contents.start, contents.end, sum(dict(contents.counts).values()), firsts)


Numbered = tuple[int, Item]
"""A result or event and its number, or a block and the number of its first row."""


class History:
    """Serves the recordings of the recorder's cell in ``folder``, and the file being written. Thread-safe."""

    def __init__(self, folder: Path, recorder: Recorder) -> None:
        self._folder = folder
        self._recorder = recorder
        self._lock = threading.Lock()
        self._known: dict[Path, FileIndex] = {}
        self._chunks: OrderedDict[Path, tuple[Chunks, dict[int, Track]]] = OrderedDict()

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> list[Batch]:
        """Recorded samples ``first`` … ``first + count`` of a stream, in order.

        If none of them is stored any more, the first ``count`` after them.

        Reads files and may wait for a flush: never call it on the event loop. Raises ``RepairingError``.
        """
        found = self._asked(topic_of(source, stream), session, first, count)
        return [item for _, item in found if isinstance(item, Batch)]

    def frames(self, session: int, first: int, count: int) -> list[Frames]:
        """Recorded frames, as ``history``."""
        return [item for _, item in self._asked(FRAME_TOPIC, session, first, count) if isinstance(item, Frames)]

    def results(self, series: str, session: int, first: int, count: int) -> list[tuple[int, Result | Event]]:
        """Recorded results or events of a series with their numbers, as ``history``."""
        found = self._asked(series, session, first, count)
        return [(number, item) for number, item in found if isinstance(item, Result | Event)]

    def recordings(self) -> list[dict[str, Any]]:
        """The stored files, oldest first: file, session, start, end (UTC ns), bytes, messages, state; JSON-ready."""
        with self._lock:
            return [
                {
                    "file": known.stored.path.name,
                    "session": known.stored.name.session,
                    "start": known.start,
                    "end": known.end,
                    "bytes": known.stored.size,
                    "messages": known.messages,
                    "state": known.state,
                }
                for known in self._files()
            ]

    def _asked(self, name: str, session: int, first: int, count: int) -> list[Numbered]:
        repairing = self._recorder.upkeep.repairing(session)
        with self._lock:
            found = self._find(name, session, first, count)
            end = found[-1][0] + _length(found[-1][1]) if found else first
            if end < first + count and self._recorder.flush(FLUSH_TIMEOUT):
                found = self._find(name, session, first, count)
        if repairing and (not found or found[0][0] > first):
            raise RepairingError(f"the recording from number {first} on is being repaired: ask again later")
        return found

    def _files(self) -> list[FileIndex]:
        """Indexes of all files of the cell in order; only changed files are read again."""
        files, fresh = listing(self._folder, self._recorder.cell), dict[Path, FileIndex]()
        live = self._recorder.live()  # after the listing: of its open files, the one that is not live has its summary
        for stored in files:
            old = self._known.get(stored.path)
            if live is not None and stored.path == live[0]:
                fresh[stored.path] = index_of(stored, live[1], "open")
            elif old is not None and old.state != "open" and old.stored == stored:
                fresh[stored.path] = old
            else:
                fresh[stored.path] = look_at(stored)
        self._known = fresh
        return list(fresh.values())

    def _find(self, name: str, session: int, first: int, count: int) -> list[Numbered]:
        """The stored rows of ``first`` … ``first + count``; if none is stored, the first ``count`` rows after them."""
        files = [f for f in self._files() if f.stored.name.session == session and name in f.firsts]
        files = files[max(bisect_right(files, first, key=lambda f: f.firsts[name][1]) - 1, 0) :]
        found = list(self._between(files, name, first, first + count))
        if not found and (later := next(self._between(files, name, first, sys.maxsize), None)) is not None:
            found = list(self._between(files, name, later[0], later[0] + count))
        return found

    def _between(self, files: Iterable[FileIndex], name: str, first: int, stop: int) -> Iterator[Numbered]:
        """Stored items of a topic or series in ``files``, from number ``first`` to before ``stop``."""
        for known in takewhile(lambda f: f.firsts[name][1] < stop, files):
            channel = known.firsts[name][0]
            try:
                chunks, tracks = self._listed(known)
                with open_recording(known.stored.path)[1] as file:
                    since = _since(first, file, chunks.holding(channel), tracks, channel)
                    for each in takewhile(lambda f: f[0] < stop, since):
                        yield from _part(each, first, stop)
            except (OSError, RecordingError):
                continue  # removed: the other files are read

    def _listed(self, known: FileIndex) -> tuple[Chunks, dict[int, Track]]:
        """Chunks and tracks of a file; those of the last few closed files are cached."""
        path = known.stored.path
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


def _since(first: int, file: FileIO, chunks: Chunks, tracks: Mapping[int, Track], channel: int) -> Iterator[Numbered]:
    """Items of a channel from the chunk that holds the number ``first`` on; ``chunks`` are those with the channel."""

    def items(at: int) -> Iterator[Numbered]:
        """Items of the chunks from ``at`` on, without damaged chunks."""
        for index in range(at, len(chunks)):  # each is decoded when needed: a slice would decode all
            with suppress(ValueError):
                yield from numbered_items(file, chunks[index], tracks, {channel})

    order = range(len(chunks))
    behind = bisect_right(order, first, key=lambda at: next(items(at), (sys.maxsize,))[0])
    return items(max(behind - 1, 0))


def _part(each: Numbered, first: int, stop: int) -> Iterator[Numbered]:
    """The rows of an item with numbers from ``first`` to before ``stop``."""
    number, item = each
    low, high = max(first - number, 0), min(stop - number, _length(item))
    if low < high:
        yield number + low, cut(item, low, high) if isinstance(item, Batch | Frames) else item


def _length(item: Item) -> int:
    return len(item) if isinstance(item, Batch | Frames) else 1
