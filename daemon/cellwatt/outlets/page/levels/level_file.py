"""Level files: what ``Gathering`` makes of a recording, in a file beside the recordings.

A file begins with magic, length and CRC-32 of its head (JSON, zlib), then come blocks, each with its CRC-32 in the
head: the buckets of each level of each set of channels, and the intervals. Numbers are little-endian.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from io import FileIO
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter

from cellwatt.files import COMPUTED, open_file
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, levels
from cellwatt.outlets.page.levels.gathering import SPANS, Columns, Gathering, Intervals, Said
from cellwatt.record import messages
from cellwatt.record.header import PART, FileName, plain_cell
from cellwatt.results import Alarm, Event

FOLDER: Final = "levels"
"""Folder of the level files, in that of the recordings."""
SUFFIX: Final = ".levels"
VERSION: Final = 1
_MAGIC: Final = b"\x89CWLV\r\n\x1a"
_LENGTHS: Final = struct.Struct("<QI")
_LARGEST_HEAD: Final = 1 << 26  # bytes, unpacked


@dataclass(frozen=True, slots=True)
class Place:
    """A block of a file: ``count`` buckets or intervals in ``length`` bytes at ``offset``."""

    offset: int
    length: int
    crc: int
    count: int


@dataclass(frozen=True, slots=True)
class Head:
    """Head of a level file: of which recording it is, its span in UTC ns, what it says, and where the blocks are.

    ``places`` has those of each level, ``whats`` belongs to the intervals.
    """

    version: int
    recording: str
    size: int
    start: int
    end: int
    sets: tuple[tuple[Columns, tuple[Place, ...]], ...]
    intervals: Place
    whats: tuple[tuple[str, tuple[int, ...], bool], ...]
    alarms: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    @property
    def said(self) -> Said:
        """Alarms and the word of people. Raises ``ValueError`` where they are damaged."""
        return Said(tuple(_decoded(Alarm, self.alarms)), tuple(_decoded(Event, self.words)))


_HEAD: Final = TypeAdapter(Head)


def path_of(recording: Path) -> Path:
    """Path of a recording's level file."""
    name = recording.name.removesuffix(PART).removesuffix(".mcap")
    return recording.parent / FOLDER / f"{name}{SUFFIX}"


def recording_of(path: Path) -> FileName | None:
    """Name of the recording to which a level file belongs; None where it is no level file."""
    return FileName.parse(path.name.removesuffix(SUFFIX) + ".mcap") if path.name.endswith(SUFFIX) else None


def write(recording: Path, size: int, gathered: Gathering) -> int:
    """Write the level file of a closed recording of ``size`` bytes, wholly or not at all; gives its bytes.

    Raises ``OSError``.
    """
    head, blocks = _laid_out(recording.name, size, gathered)
    packed = zlib.compress(json.dumps(head, separators=(",", ":")).encode(), 1)
    path = path_of(recording)
    path.parent.mkdir(exist_ok=True)
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    try:
        with new.open("wb") as file:
            file.write(_MAGIC + _LENGTHS.pack(len(packed), zlib.crc32(packed)) + packed)
            for block in blocks:
                file.write(block)
            written = file.tell()
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
    return written


def _laid_out(name: str, size: int, gathered: Gathering) -> tuple[dict[str, Any], list[bytes]]:
    blocks: list[bytes] = []
    offset = 0

    def placed(data: bytes, count: int) -> tuple[int, int, int, int]:
        nonlocal offset
        blocks.append(data)
        offset += len(data)
        return offset - len(data), len(data), zlib.crc32(data), count

    sets = [
        (columns, [placed(packed(buckets), len(buckets)) for buckets in levels(finest)])
        for columns, finest in gathered.finest().items()
    ]
    intervals, said = gathered.intervals, gathered.said
    keys = ("offset", "length", "crc", "count")
    head = {
        "version": VERSION,
        "recording": name,
        "size": size,
        "start": gathered.start,
        "end": gathered.end,
        "sets": [(columns, [dict(zip(keys, place, strict=True)) for place in places]) for columns, places in sets],
        "intervals": dict(zip(keys, placed(intervals.spans.tobytes(), len(intervals.spans)), strict=True)),
        "whats": intervals.whats,
        "alarms": [messages.encode(alarm).decode() for alarm in said.alarms],
        "words": [messages.encode(word).decode() for word in said.words],
    }
    return head, blocks


def packed(buckets: Buckets) -> bytes:
    """Buckets as a block."""
    parts = (buckets.index.astype("<i8"), buckets.low.astype("<f4"), buckets.high.astype("<f4"))
    return b"".join(part.tobytes() for part in parts)


def unpacked(data: bytes, channels: int, count: int) -> Buckets:
    """Buckets back from their block. Raises ``ValueError`` where its length is another."""
    if len(data) != count * (8 + 8 * channels):
        raise ValueError("a block's length is wrong")
    index = np.frombuffer(data, "<i8", count)
    low = np.frombuffer(data, "<f4", count * channels, 8 * count)
    high = np.frombuffer(data, "<f4", count * channels, 8 * count + low.nbytes)
    return Buckets(index, low.reshape(channels, count), high.reshape(channels, count))


class LevelFile:
    """A level file to be read. Raises ``OSError``, and ``ValueError`` where it is damaged or of another recording.

    So do its methods.
    """

    def __init__(self, recording: Path, size: int) -> None:
        self.path = path_of(recording)
        with open_file(self.path, COMPUTED) as file:
            self.head, self._after = _head(file)
        if (self.head.recording, self.head.size) != (recording.name, size):
            raise ValueError("belongs to another recording")
        self.start, self.end, self.said = self.head.start, self.head.end, self.head.said

    def levels(self, level: int, wanted: Sequence[str]) -> list[tuple[Columns, Buckets]]:
        """Buckets of one of ``STEPS`` of all sets of channels in which one of ``wanted`` is."""
        found = [(columns, places[level]) for columns, places in self.head.sets if not set(wanted).isdisjoint(columns)]
        if not found:
            return []
        with open_file(self.path, COMPUTED) as file:
            return [(columns, unpacked(self._block(file, at), len(columns), at.count)) for columns, at in found]

    def intervals(self) -> Intervals:
        """Intervals of the recording."""
        with open_file(self.path, COMPUTED) as file:
            data = self._block(file, self.head.intervals)
        spans = np.frombuffer(data, SPANS)
        if len(spans) and int(spans["what"].max()) >= len(self.head.whats):
            raise ValueError("an interval is of a kind that is not told")
        return Intervals(spans, self.head.whats)

    def _block(self, file: FileIO, place: Place) -> bytes:
        data = os.pread(file.fileno(), place.length, self._after + place.offset)
        if len(data) != place.length or zlib.crc32(data) != place.crc:
            raise ValueError("a block is damaged")
        return data


def _head(file: FileIO) -> tuple[Head, int]:
    front = file.read(len(_MAGIC) + _LENGTHS.size)
    if len(front) != len(_MAGIC) + _LENGTHS.size or not front.startswith(_MAGIC):
        raise ValueError("is no level file")
    length, crc = _LENGTHS.unpack_from(front, len(_MAGIC))
    body = file.read(min(length, _LARGEST_HEAD))
    if len(body) != length or zlib.crc32(body) != crc:
        raise ValueError("its head is damaged")
    try:
        head = _HEAD.validate_json(_inflated(body))
    except zlib.error:
        raise ValueError("its head is damaged") from None
    if head.version != VERSION or any(len(places) != len(STEPS) for _, places in head.sets):
        raise ValueError(f"is of version {head.version}")
    return head, len(front) + length


def _inflated(body: bytes) -> bytes:
    inflater = zlib.decompressobj()
    data = inflater.decompress(body, _LARGEST_HEAD)
    if not inflater.eof:
        raise ValueError("its head is too large")
    return data


def _decoded(kind: Any, texts: Sequence[str]) -> list[Any]:
    return [messages.decode(kind, text.encode()) for text in texts]


class Budget:
    """Holds the level files of ``cell`` in the folder of the recordings below ``most`` bytes."""

    def __init__(self, folder: Path, cell: str, most: float) -> None:
        self._folder, self._cell, self._most = folder / FOLDER, plain_cell(cell), most
        self._oldest: tuple[int, int] | None = None
        """Session and number of the newest recording whose file went."""

    def allows(self, recording: FileName) -> bool:
        """False for a recording that is as old as one whose file went, or older."""
        return self._oldest is None or (recording.session, recording.number) > self._oldest

    def files(self) -> list[tuple[FileName, os.DirEntry[str]]]:
        """Level files of the cell by the names of their recordings. Raises ``OSError``."""
        try:
            with os.scandir(self._folder) as entries:
                named = [(recording_of(Path(entry.name)), entry) for entry in entries]
        except FileNotFoundError:
            return []
        return [(name, entry) for name, entry in named if name is not None and name.cell == self._cell]

    def hold(self) -> int:
        """Remove what is too much; return the number of files that went. Raises ``OSError``."""
        there = sorted((((n.session, n.number), entry) for n, entry in self.files()), key=itemgetter(0))
        total, gone = sum(_size(entry) for _, entry in there), 0
        for age, entry in there:
            if total <= self._most:
                break
            total -= _size(entry)
            Path(entry.path).unlink(missing_ok=True)
            self._oldest, gone = age, gone + 1
        return gone


def _size(entry: os.DirEntry[str]) -> int:
    try:
        return entry.stat().st_size
    except FileNotFoundError:
        return 0
