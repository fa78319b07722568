"""Reads recordings for their levels: one that grows, chunk by chunk; a closed one; or its level file."""

from __future__ import annotations

import os
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Final

from mcap.opcode import Opcode

from cellwatt.files import open_file
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, coarser
from cellwatt.outlets.page.levels.gathering import CURVES, TELLING, Columns, Gathering, Intervals
from cellwatt.outlets.page.levels.level_file import LevelFile
from cellwatt.record import decoder
from cellwatt.record.chunks import LARGEST_RECORD, definitions, open_chunk, parse_attachment
from cellwatt.record.container import CHUNK_HEAD, MAGIC, RECORD, Chunk, Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.encoder import Item
from cellwatt.record.openfile import DEFINITIONS
from cellwatt.record.scan import read_at
from cellwatt.record.survey import open_recording, survey

EVERYTHING: Final = CURVES | TELLING
WINDOW: Final = 1 << 20
"""Bytes read at once."""
_INDEX: Final = struct.Struct("<H")
_LAST: Final = int(max(Opcode))
_FRONT: Final = RECORD.size + CHUNK_HEAD.size
"""Bytes of a record that are looked at."""


Places = Sequence[tuple[int, int, int, int]]
"""Chunks of a recording, in order of the file: offset, length, and times from and to in UTC ns."""


def items_at(file: FileIO, offset: int, length: int, tracks: Mapping[int, Track], wanted: frozenset[int]) -> list[Item]:
    """Items of some channels in a chunk. Raises ``ValueError`` where it is damaged."""
    return list(decoder.items(open_chunk(read_at(file, length, offset)[RECORD.size :]).data, tracks, wanted))


class Growing:
    """A recording that is open, or was when it was first seen, and what was gathered of it; used under ``lock``.

    Only chunks that have something to show are opened. One that cannot be read is passed over; what is not
    whole yet waits for the next look.
    """

    def __init__(self, path: Path) -> None:
        self.lock = threading.Lock()
        self.gathered = Gathering()
        self.places: list[tuple[int, int, int, int]] = []
        """See ``Places``."""
        self.tracks: dict[int, Track] = {}
        """Readers of the channels that are defined so far."""
        self._ended = False
        self._identity: tuple[int, int] | None = None
        self._path = path
        self._at = len(MAGIC)
        self._contents = Contents()
        self._wanted: frozenset[int] = frozenset()
        self._defined = b""
        self._chunk: tuple[int, int] | None = None
        """Offset and length of the last chunk, while it is not known whether it is wanted."""

    def grow(self, until: float) -> bool:
        """Take what came since, as far as that goes before monotonic time ``until``; true if all was taken.

        Raises ``OSError``.
        """
        if self._ended:
            return True
        self._path, file = open_recording(self._path)
        with file:
            status = os.fstat(file.fileno())
            if self._identity not in (None, (status.st_dev, status.st_ino)):
                raise FileNotFoundError(f"{self._path} is another file")
            self._identity = (status.st_dev, status.st_ino)
            if read_at(file, len(MAGIC), 0) != MAGIC:
                return True
            for items in self._records(file, status.st_size):
                for item in items:
                    self.gathered.add(item)
                if time.monotonic() > until:
                    return False
        return True

    def _records(self, file: FileIO, size: int) -> Iterator[list[Item]]:
        window, base = b"", self._at
        while not self._ended:
            if self._at + _FRONT > base + len(window) < size:
                window, base = read_at(file, WINDOW, self._at), self._at
            front = window[self._at - base :][:_FRONT]
            if len(front) < RECORD.size:
                return
            opcode, length = RECORD.unpack_from(front)
            if not 0 < opcode <= _LAST or length > LARGEST_RECORD or self._at + RECORD.size + length > size:
                return  # not written wholly yet, or torn
            wanted = self._chunk if self._tells_of_wanted(opcode, length, front) else None
            if wanted is not None:
                self._chunk = None
            self._note(file, opcode, length, front)
            self._at += RECORD.size + length
            if wanted is not None:
                with suppress(ValueError):
                    yield items_at(file, *wanted, self.tracks, self._wanted)  # at last: a caller may go on later

    def _note(self, file: FileIO, opcode: int, length: int, front: bytes) -> None:
        """Note a record; of a chunk the place alone, until the message indexes behind it tell what is in it."""
        if opcode == Opcode.CHUNK and length >= CHUNK_HEAD.size:
            start, end, _, _ = CHUNK_HEAD.unpack_from(front, RECORD.size)
            self._chunk = (self._at, RECORD.size + length)
            self.places.append((*self._chunk, start, end))
        elif opcode == Opcode.ATTACHMENT:
            self._define(read_at(file, length, self._at + RECORD.size))
        self._ended = opcode == Opcode.DATA_END

    def _tells_of_wanted(self, opcode: int, length: int, front: bytes) -> bool:
        """True for the index of a channel that is wanted."""
        if opcode != Opcode.MESSAGE_INDEX or length < _INDEX.size:
            return False
        return _INDEX.unpack_from(front, RECORD.size)[0] in self._wanted

    def _define(self, body: bytes) -> None:
        """Take over the definitions of channels, which stand before the chunk that needs them."""
        with suppress(ValueError):
            attachment = parse_attachment(body)
            if attachment.name == DEFINITIONS and attachment.data != self._defined:
                self._contents.define(definitions(attachment.data))
                self._defined = attachment.data
                self.tracks = tracks_of(self._contents.channels)[0]
                self._wanted = frozenset(n for n, track in self.tracks.items() if track.topic in EVERYTHING)


Pace = Callable[[], None]
"""Called after each chunk: may sleep, or raise to stop."""


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


Source = LevelFile | Held
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
                for item in items_at(file, chunk.offset, chunk.length, tracks, wanted):
                    gathered.add(item)
            pace()
    return gathered


def _holding(contents: Contents, wanted: frozenset[int]) -> list[Chunk]:
    """The chunks with messages of some channels, in order, each once."""
    chunks = {chunk.offset: chunk for number in wanted for chunk in contents.chunks.holding(number)}
    return [chunks[offset] for offset in sorted(chunks)]
