"""Reads the chunks of recordings: of a closed recording all or those of a span, of an open one the new ones."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from io import FileIO
from pathlib import Path
from typing import Final

from mcap.opcode import Opcode

from cellwatt.files import open_file
from cellwatt.outlets.page.levels.gathering import CURVES, TELLING, Digest, Gathering
from cellwatt.record.chunks import LARGEST_RECORD, definitions, parse_attachment, read_at
from cellwatt.record.container import CHUNK_HEAD, MAGIC, RECORD, Chunk, Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import Item
from cellwatt.record.openfile import DEFINITIONS
from cellwatt.record.reader import numbered_items
from cellwatt.record.survey import open_recording, survey

_LAST: Final = int(max(Opcode))

Pace = Callable[[], None]
"""Called after each chunk; may sleep, or raise an exception to stop."""


@dataclass
class Places:
    """The chunks of a recording, in file order, and the decoders of its channels."""

    chunks: Iterable[Chunk] = ()
    tracks: Mapping[int, Track] = field(default_factory=dict)

    def items(self, file: FileIO, topics: frozenset[str], start: int = 0, end: int = 2**63) -> Iterator[list[Item]]:
        """Items of ``topics`` per chunk that overlaps the span ``start`` to ``end``, UTC ns; skips damaged chunks."""
        wanted = {number for number, track in self.tracks.items() if track.topic in topics}
        for chunk in self.chunks:
            unwanted = chunk.indexes and wanted.isdisjoint(number for number, _ in chunk.indexes)
            if chunk.start < end and chunk.end >= start and not unwanted:
                with suppress(ValueError):
                    yield [item for _, item in numbered_items(file, chunk, self.tracks, wanted)]


@lru_cache(maxsize=3)
def places_in(path: Path, size: int) -> Places:
    """The chunks of a closed recording of ``size`` bytes. Raises ``RecordingError``."""
    contents = survey(path).contents
    return Places(contents.chunks, tracks_of(contents.channels)[0])


def gather(path: Path, size: int, topics: frozenset[str], pace: Pace) -> Digest:
    """Digest of ``topics`` of a closed recording. Raises ``OSError``, and ``RecordingError`` if it is unreadable."""
    gathering = Gathering()
    with open_file(path) as file:
        for items in places_in(path, size).items(file, topics):
            for item in items:
                gathering.add(item)
            pace()
    return gathering.digest()


class Growing:
    """A recording that is open, or was open when first read; hold ``lock`` to use it.

    An MCAP record that is not completely written yet is read by the next call of ``grow``.
    """

    def __init__(self, path: Path) -> None:
        self.lock = threading.Lock()
        self.gathering = Gathering()
        self.chunks: list[Chunk] = []
        self.tracks: Mapping[int, Track] = {}
        self._path = path
        self._at = len(MAGIC)
        self._contents = Contents()

    def grow(self, pace: Pace) -> None:
        """Read the records written since the last call.

        Raises ``OSError``, and exceptions of ``pace``: then the next call reads the remainder.
        """
        self._path, file = open_recording(self._path)
        with file:
            size = os.fstat(file.fileno()).st_size
            while len(head := read_at(file, RECORD.size + CHUNK_HEAD.size, self._at)) >= RECORD.size:
                opcode, length = RECORD.unpack_from(head)
                at, self._at = self._at, self._at + RECORD.size + length
                if not 0 < opcode <= _LAST or opcode == Opcode.DATA_END or length > LARGEST_RECORD or self._at > size:
                    self._at = at
                    return
                if opcode == Opcode.ATTACHMENT:
                    self._define(read_at(file, length, at + RECORD.size))
                elif opcode == Opcode.CHUNK and length >= CHUNK_HEAD.size:
                    start, end, _, _ = CHUNK_HEAD.unpack_from(head, RECORD.size)
                    self.chunks.append(Chunk(at, RECORD.size + length, start, end, 0, 0, (), 0))
                    for items in Places(self.chunks[-1:], self.tracks).items(file, CURVES | TELLING):
                        for item in items:
                            self.gathering.add(item)
                    pace()

    def _define(self, body: bytes) -> None:
        """Read the definitions of channels, which precede the chunk that needs them."""
        with suppress(ValueError):
            attachment = parse_attachment(body)
            if attachment.name == DEFINITIONS:
                self._contents.define(definitions(attachment.data))
                self.tracks = tracks_of(self._contents.channels)[0]
