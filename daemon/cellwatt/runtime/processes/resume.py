"""End of the record of a process that was killed, so that its successor writes nothing twice."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path

from cellwatt.batch import Batch
from cellwatt.blocks import Block, cut
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.record import Recorder, decoder
from cellwatt.record.decoder import tracks_of
from cellwatt.record.encoder import Item
from cellwatt.record.messages import Message
from cellwatt.record.opening import survey
from cellwatt.record.reader import chunk_data
from cellwatt.record.retention import listing

log = logging.getLogger(__name__)

LAST = 8
"""Chunks at the end of a file in which what a ring still holds may be."""


@dataclass(slots=True)
class Resume:
    """The number with which each stream, and the frames, go on after what is in the record."""

    following: dict[tuple[str, str], int] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    """The last ones."""

    @classmethod
    async def of(cls, recorder: Recorder | None, *, restarts: int) -> Resume:
        """Read what this session's record holds; empty where the process is the first of its session."""
        if recorder is None or not restarts:
            return cls()
        await recorder.recovered()
        return await asyncio.to_thread(cls._read, recorder.settings.folder, recorder.cell, recorder.session)

    @classmethod
    def _read(cls, folder: Path, cell: str, session: int) -> Resume:
        found = cls()
        files = [f for f in listing(folder, cell) if f.name.session == session and f.closed]
        for kept in files[-2:]:
            try:
                contents = survey(kept.path).contents
            except RecordingError:
                continue
            tracks, _ = tracks_of(contents.channels)
            with FileIO(kept.path, "rb") as file:
                for chunk in contents.chunks[-LAST:]:
                    try:
                        found._note(list(decoder.items(chunk_data(file, chunk), tracks, tracks)))
                    except ValueError as error:
                        log.warning("%s: the chunk at %d is passed over: %s", kept.path.name, chunk.offset, error)
        return found

    def _note(self, items: Iterable[Item]) -> None:
        for item in items:
            if isinstance(item, Batch | Frames):
                self.following[_key(item)] = item.sequence + len(item)
            else:
                self.messages.append(item)

    def lacks(self, message: Message) -> bool:
        """True if a result or event is not in the record yet."""
        if message in self.messages:
            self.messages.remove(message)
            return False
        return True

    def fresh(self, item: Block) -> Block | None:
        """Rows of a block that are not in the record yet; None where all are."""
        first = self.following.get(_key(item), 0)
        if item.sequence >= first:
            return item
        if item.sequence + len(item) <= first:
            return None
        return cut(item, first - item.sequence, len(item))


def _key(item: Batch | Frames) -> tuple[str, str]:
    return (item.source, item.stream.name) if isinstance(item, Batch) else ("", "")
