"""Level files: what ``Gathering`` makes of a recording, in a zip archive beside the recordings.

It holds ``head`` (JSON), ``intervals``, and under ``<set>/<level>`` the buckets of each level of each set of channels,
little-endian. The archive's checksums tell what is damaged.
"""

from __future__ import annotations

import json
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter

from cellwatt.files import COMPUTED, open_file
from cellwatt.outlets.page.levels.buckets import Buckets, levels
from cellwatt.outlets.page.levels.gathering import SPANS, Columns, Gathering, Intervals, Said
from cellwatt.record import messages
from cellwatt.record.header import PART, FileName, plain_cell
from cellwatt.results import Alarm, Event

FOLDER: Final = "levels"
"""Folder of the level files, in that of the recordings."""
SUFFIX: Final = ".levels"
VERSION: Final = 2
_HEAD_NAME, _INTERVALS = "head", "intervals"
_LARGEST_HEAD: Final = 1 << 26  # bytes, unpacked
_DAMAGED: Final = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, NotImplementedError, RuntimeError,
)  # fmt: skip
"""Errors of reading an archive that was changed; ``ValueError`` beside them."""


@dataclass(frozen=True, slots=True)
class Head:
    """Head of a level file: of which recording it is, its span in UTC ns, its sets of channels, and what it says.

    ``whats`` belongs to the intervals.
    """

    version: int
    recording: str
    size: int
    start: int
    end: int
    sets: tuple[Columns, ...]
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


def write(recording: Path, size: int, gathered: Gathering) -> None:
    """Write the level file of a closed recording of ``size`` bytes, wholly or not at all. Raises ``OSError``."""
    intervals, said, finest = gathered.intervals, gathered.said, gathered.finest()
    head = {
        "version": VERSION,
        "recording": recording.name,
        "size": size,
        "start": gathered.start,
        "end": gathered.end,
        "sets": list(finest),
        "whats": intervals.whats,
        "alarms": [messages.encode(alarm).decode() for alarm in said.alarms],
        "words": [messages.encode(word).decode() for word in said.words],
    }
    path = path_of(recording)
    path.parent.mkdir(exist_ok=True)
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    try:
        with zipfile.ZipFile(new, "w") as archive:
            archive.writestr(_HEAD_NAME, json.dumps(head, separators=(",", ":")), zipfile.ZIP_DEFLATED, 1)
            archive.writestr(_INTERVALS, intervals.spans.tobytes())
            for place, buckets in enumerate(finest.values()):
                for level, of_level in enumerate(levels(buckets)):
                    archive.writestr(f"{place}/{level}", _packed(of_level))
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _packed(buckets: Buckets) -> bytes:
    parts = (buckets.index.astype("<i8"), buckets.low.astype("<f4"), buckets.high.astype("<f4"))
    return b"".join(part.tobytes() for part in parts)


def _unpacked(data: bytes, channels: int) -> Buckets:
    count, rest = divmod(len(data), 8 + 8 * channels)
    if rest:
        raise ValueError("a block's length is wrong")
    index = np.frombuffer(data, "<i8", count)
    low, high = np.frombuffer(data, "<f4", offset=8 * count).reshape(2, channels, count)
    return Buckets(index, low, high)


class LevelFile:
    """A level file to be read. Raises ``OSError``, and ``ValueError`` where it is damaged or of another recording.

    So do its methods.
    """

    def __init__(self, recording: Path, size: int) -> None:
        self.path = path_of(recording)
        with _archive(self.path) as archive:
            if archive.getinfo(_HEAD_NAME).file_size > _LARGEST_HEAD:
                raise ValueError("its head is too large")
            self._head = _HEAD.validate_json(archive.read(_HEAD_NAME))
        if self._head.version != VERSION:
            raise ValueError(f"is of version {self._head.version}")
        if (self._head.recording, self._head.size) != (recording.name, size):
            raise ValueError("belongs to another recording")
        self.start, self.end, self.said = self._head.start, self._head.end, self._head.said

    def levels(self, level: int, wanted: Sequence[str]) -> list[tuple[Columns, Buckets]]:
        """Buckets of one of ``STEPS`` of all sets of channels in which one of ``wanted`` is."""
        found = [(n, columns) for n, columns in enumerate(self._head.sets) if not set(wanted).isdisjoint(columns)]
        if not found:
            return []
        with _archive(self.path) as archive:
            return [(columns, _unpacked(archive.read(f"{n}/{level}"), len(columns))) for n, columns in found]

    def intervals(self) -> Intervals:
        """Intervals of the recording."""
        with _archive(self.path) as archive:
            spans = np.frombuffer(archive.read(_INTERVALS), SPANS)
        if len(spans) and int(spans["what"].max()) >= len(self._head.whats):
            raise ValueError("an interval is of a kind that is not told")
        return Intervals(spans, self._head.whats)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    with open_file(path, COMPUTED) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                yield archive
        except _DAMAGED as error:
            raise ValueError(f"is damaged: {error}") from None


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
