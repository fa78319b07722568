"""Copies a span of time from the record into one file, also while the record is written."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from cellwatt.errors import RecordingError, why
from cellwatt.record.encoder import Encoder, Item, Redeclared
from cellwatt.record.files import CHUNK
from cellwatt.record.header import PART, Header
from cellwatt.record.openfile import OpenFile
from cellwatt.record.overlap import reach, recordings_between
from cellwatt.record.reader import Recording
from cellwatt.record.survey import utc


@dataclass(frozen=True, slots=True)
class Cut:
    """A file cut out of the record; ``start`` and ``end`` (UTC ns) are those of its contents.

    ``sources`` are the files that it was cut from; ``lost`` has a line for each part of them that is unreadable.
    """

    path: Path
    start: int
    end: int
    messages: int
    size: int
    sources: tuple[Path, ...]
    lost: tuple[str, ...]


def cut(folder: Path, cell: str, start: int, end: int, to: Path, *, reserve: float = 0.0) -> Cut:
    """Write the recordings of a cell in ``folder`` from ``start`` to ``end`` (UTC ns) to the file ``to``.

    The file is a complete recording. It appears under its name once it is whole, and replaces an existing file.
    Its header is that of the newest file in the span. The caller may be interrupted at any time: a partial file
    (suffix ``.part``) is overwritten by the next call. ``reserve`` bytes of the disk stay free.

    Raises ``RecordingError`` if nothing was recorded in that span or the file cannot be written.
    """
    files = recordings_between(folder, cell, start, end)
    within = [file.path for file in files if file.closed or reach(file)[0] <= end]
    nothing = f"{folder}: nothing of cell {cell} was recorded from {utc(start)} to {utc(end)}"
    if not within:
        raise RecordingError(nothing)
    recording = Recording.open(within).between(start, end)
    file = write_file(to, replace(recording.spans[-1][0], number=0), recording.items(), reserve)
    contents = file.contents
    if not contents.chunks:
        raise RecordingError(nothing)
    lost = tuple(map(str, recording.damage))
    return Cut(to, contents.start, contents.end, contents.counts.total(), file.size, recording.paths, lost)


def write_file(to: Path, header: Header, items: Iterable[tuple[Header, Item]], reserve: float = 0.0) -> OpenFile:
    """Write items, each with the header of its recording, to the file ``to``, atomically; without items no file.

    Raises ``RecordingError`` if it cannot be written.
    """
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        to.with_name(to.name + PART).unlink(missing_ok=True)
        file = OpenFile(to, header)
        try:
            _fill(file, items, reserve)
            if file.contents.chunks:
                file.finish()
                file.publish()
        finally:
            file.discard()
    except OSError as error:
        raise RecordingError(f"{to} cannot be written: {why(error)}") from error
    return file


def _fill(file: OpenFile, items: Iterable[tuple[Header, Item]], reserve: float) -> None:
    session, encoder = -1, Encoder(file)
    for header, item in items:
        if header.session != session:  # sample numbers restart
            session, encoder = header.session, Encoder(file)
        try:
            encoder.add(item)
        except Redeclared:
            encoder = Encoder(file)
            encoder.add(item)
        if file.waiting > CHUNK:
            _check_room(file, reserve)
            file.write_chunk()
    _check_room(file, reserve)
    file.write_chunk()


def _check_room(file: OpenFile, reserve: float) -> None:
    if reserve and shutil.disk_usage(file.path.parent).free - file.waiting < reserve:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
