"""Finds the end of the record that a killed process wrote, so that its successor records nothing twice."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Final

from cellwatt.batch import Batch
from cellwatt.errors import RecordingError
from cellwatt.frames import Block, Frames, cut
from cellwatt.record import Recorder
from cellwatt.record.container import Chunk, Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import Item, topic_of_block
from cellwatt.record.folder import RecordFile, listing
from cellwatt.record.history import look_at
from cellwatt.record.messages import Message, time_of
from cellwatt.record.reader import numbered_items
from cellwatt.record.survey import survey
from cellwatt.results import Event, Result, series_of

log = logging.getLogger(__name__)

RECENT: Final = 5 * 10**9
"""Time before the end of a file, ns, in which it may hold items still in a ring: *tell* settles them each second."""
SEARCHED: Final = 86_400 * 10**9
"""Time before the end of the record, ns, that is searched for the last item of a series: weeks would take minutes."""


@dataclass(slots=True)
class Resume:
    """Next numbers after the end of the record."""

    messages: list[Message] = field(default_factory=list)
    """Last recorded messages."""
    following: dict[str, int] = field(default_factory=dict)
    """Next number of each topic of blocks, and of each series of results or events that was found …"""
    since: int = 0
    """… after this time, UTC ns; older items have been recorded."""

    @classmethod
    async def of(cls, recorder: Recorder | None, series: Collection[str], *, restarts: int) -> Resume:
        """Read the end of this session's record; empty if the process is the first of its session.

        ``series`` are the series that have been published.
        """
        if recorder is None or not restarts:
            return cls()
        await recorder.upkeep.recovered()
        return await asyncio.to_thread(cls._read, recorder.settings.folder, recorder.cell, recorder.session, series)

    @classmethod
    def _read(cls, folder: Path, cell: str, session: int, series: Collection[str]) -> Resume:
        found = cls()
        files = [f for f in listing(folder, cell) if f.name.session == session and f.closed]
        found.following, found.since = _ends(files, set(series))
        for file, contents, tracks in _readable(files[-2:]):
            for chunk in (c for c in contents.chunks if c.end > contents.end - RECENT):
                for number, item in _items(file, chunk, tracks, tracks):
                    if isinstance(item, Batch | Frames):
                        found.following[topic_of_block(item)] = number + len(item)
                    else:
                        found.messages.append(item)
        return found

    def unrecorded(self, published: Iterable[tuple[int, Result | Event]]) -> list[tuple[int, Result | Event]]:
        """Of the published results and events ``published``, those missing in the record, with their numbers."""
        found = []
        for number, item in published:
            following = self.following.get(series_of(item))
            if time_of(item) > self.since if following is None else number >= following:
                found.append((number, item))
        self.messages += [item for _, item in found]
        return found

    def lacks(self, message: Message) -> bool:
        """True if a result or event is not in the record yet."""
        if message in self.messages:
            self.messages.remove(message)
            return False
        return True

    def fresh(self, item: Block) -> Block | None:
        """Rows of a block that are not in the record yet; None if all are."""
        first = self.following.get(topic_of_block(item), 0)
        if item.sequence >= first:
            return item
        if item.sequence + len(item) <= first:
            return None
        return cut(item, first - item.sequence, len(item))


def _ends(files: Sequence[RecordFile], series: set[str]) -> tuple[dict[str, int], int]:
    """Next number of each series that is in the record, and the time from which on it was searched."""
    ends: dict[str, int] = {}
    since = 0
    for stored in reversed(files):
        known, missing = look_at(stored), series - ends.keys()
        since = since or known.end - SEARCHED
        if not missing or 0 < known.end < since:
            break
        for file, contents, tracks in _readable([stored] if missing & known.firsts.keys() else []):
            for channel, track in tracks.items():
                for chunk in reversed(contents.chunks.holding(channel)) if track.series in missing else ():
                    if items := _items(file, chunk, tracks, {channel}):
                        ends[str(track.series)] = 1 + max(number for number, _ in items)
                        break
    return ends, since


def _readable(files: Iterable[RecordFile]) -> Iterator[tuple[FileIO, Contents, Mapping[int, Track]]]:
    for stored in files:
        try:
            contents = survey(stored.path).contents
        except RecordingError:
            continue
        with FileIO(stored.path, "rb") as file:
            yield file, contents, tracks_of(contents.channels)[0]


def _items(file: FileIO, chunk: Chunk, tracks: Mapping[int, Track], wanted: Container[int]) -> list[tuple[int, Item]]:
    """Items of a chunk with their numbers; none of a damaged chunk."""
    try:
        return numbered_items(file, chunk, tracks, wanted)
    except ValueError as error:
        log.warning("%s: the chunk at %d is skipped: %s", file.name, chunk.offset, error)
        return []
