"""Level files: the digest of a recording as a zip archive beside the recordings, whose checksums detect damage.

An archive contains ``head`` and ``intervals`` (JSON), and as ``<set>/<level>`` the buckets of each level of each set of
channels, little-endian.
"""

from __future__ import annotations

import os
import struct
import threading
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter

from cellwatt.files import COMPUTED, open_file
from cellwatt.outlets.page.levels.buckets import Buckets, levels
from cellwatt.outlets.page.levels.gathering import Columns, Digest, Span
from cellwatt.record import messages
from cellwatt.record.folder import RecordFile
from cellwatt.record.header import FileName, plain_cell
from cellwatt.results import Alarm, Event

FOLDER: Final = "levels"
"""Name of the folder of level files, inside the folder of the recordings."""
SUFFIX: Final = ".levels"
_NEW: Final = ".new"
"""Suffix of the name of a level file that is being written."""
VERSION: Final = 3
_HEAD_NAME, _INTERVALS = "head", "intervals"
_LARGEST_HEAD: Final = 1 << 26  # bytes, unpacked
_DAMAGED: Final = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, NotImplementedError, RuntimeError,
)  # fmt: skip
"""Exceptions from reading a damaged archive, beside ``ValueError``."""


@dataclass(frozen=True, slots=True)
class Head:
    """Head of a level file: name and size, bytes, of its recording, span in UTC ns, sets of channels, messages."""

    version: int
    recording: str
    size: int
    start: int
    end: int
    sets: tuple[Columns, ...]
    said: tuple[tuple[bool, str], ...]
    """True for an alarm, False for an event; and the message as JSON."""


_HEAD: Final = TypeAdapter(Head)
_SPANS: Final[TypeAdapter[list[Span]]] = TypeAdapter(list[Span])


def path_of(recording: Path) -> Path:
    """Path of a closed recording's level file."""
    return recording.parent / FOLDER / f"{recording.stem}{SUFFIX}"


def write(recording: RecordFile, digest: Digest) -> None:
    """Write the level file of a closed recording atomically. Raises ``OSError``."""
    said = tuple((isinstance(message, Alarm), messages.encode(message).decode()) for message in digest.said)
    about = (VERSION, recording.path.name, recording.size, digest.start, digest.end)
    path = path_of(recording.path)
    path.parent.mkdir(exist_ok=True)
    new = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}{_NEW}")
    try:
        with zipfile.ZipFile(new, "w") as archive:
            archive.writestr(
                _HEAD_NAME, _HEAD.dump_json(Head(*about, tuple(digest.finest), said)), zipfile.ZIP_DEFLATED
            )
            archive.writestr(_INTERVALS, _SPANS.dump_json(list(digest.spans)), zipfile.ZIP_DEFLATED)
            for number, finest in enumerate(digest.finest.values()):
                for level, buckets in enumerate(levels(finest)):
                    parts = buckets.index.astype("<i8"), buckets.low.astype("<f4"), buckets.high.astype("<f4")
                    archive.writestr(f"{number}/{level}", b"".join(part.tobytes() for part in parts))
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


class LevelFile:
    """A level file, with the interface of a ``Digest``.

    The constructor and all methods raise ``OSError``, and ``ValueError`` if the file is damaged or belongs to another
    recording.
    """

    def __init__(self, recording: RecordFile) -> None:
        self.path = path_of(recording.path)
        with _archive(self.path) as archive:
            if archive.getinfo(_HEAD_NAME).file_size > _LARGEST_HEAD:
                raise ValueError("its head is too large")
            head = _HEAD.validate_json(archive.read(_HEAD_NAME))
        if head.version != VERSION:
            raise ValueError(f"is of version {head.version}")
        if (head.recording, head.size) != (recording.path.name, recording.size):
            raise ValueError("belongs to another recording")
        self.size, self.start, self.end, self._sets = head.size, head.start, head.end, head.sets
        self.said: Sequence[Any] = [
            messages.decode(Alarm if is_alarm else Event, text.encode()) for is_alarm, text in head.said
        ]

    def levels(self, level: int, wanted: Sequence[str]) -> Iterator[tuple[str, Buckets]]:
        """See ``Digest.levels``."""
        found = [(n, columns) for n, columns in enumerate(self._sets) if not set(wanted).isdisjoint(columns)]
        if not found:
            return
        with _archive(self.path) as archive:
            for n, columns in found:
                buckets = _unpacked(archive.read(f"{n}/{level}"), len(columns))
                for name in set(wanted).intersection(columns):
                    yield name, buckets.channel(columns.index(name))

    def intervals(self) -> Sequence[Span]:
        """Intervals of the recording."""
        with _archive(self.path) as archive:
            return _SPANS.validate_json(archive.read(_INTERVALS))


def _unpacked(data: bytes, channels: int) -> Buckets:
    count, rest = divmod(len(data), 8 + 8 * channels)
    if rest:
        raise ValueError("a block's length is wrong")
    low, high = np.frombuffer(data, "<f4", offset=8 * count).reshape(2, channels, count)
    return Buckets(np.frombuffer(data, "<i8", count), low, high)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    with open_file(path, COMPUTED) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                yield archive
        except _DAMAGED as error:
            raise ValueError(f"is damaged: {error}") from None


def remove_begun(folder: Path) -> None:
    """Remove incomplete level files, left by a killed process: no two daemons share a folder. Raises ``OSError``."""
    for path in (folder / FOLDER).glob(f"*{SUFFIX}.*{_NEW}"):
        path.unlink(missing_ok=True)


def listing(folder: Path, cell: str) -> list[RecordFile]:
    """The level files of a cell's recordings in ``folder``, oldest first, each with the name of its recording.

    Raises ``OSError``.
    """
    found = []
    for path in (folder / FOLDER).glob(f"*{SUFFIX}"):
        name = FileName.parse(f"{path.stem}.mcap")
        if name is not None and name.cell == plain_cell(cell):
            with suppress(FileNotFoundError):
                status = path.stat()
                found.append(RecordFile(path, status.st_size, status.st_mtime, True, name))
    return sorted(found, key=lambda file: file.name)
