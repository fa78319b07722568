"""The contents of a file, from its summary if that is sound, else from a scan; and the files of a recording.

Files may be written, closed, repaired and removed meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path

from cellwatt.errors import RecordingError
from cellwatt.files import open_file
from cellwatt.progress import steps
from cellwatt.record.chunks import LARGEST_RECORD, parse_attachment, read_at, read_summary
from cellwatt.record.container import RECORD, Contents
from cellwatt.record.decoder import streams_of, tracks_of
from cellwatt.record.foreign import ForeignError, held, is_foreign
from cellwatt.record.header import PART, FileName, Header, closed_name
from cellwatt.record.openfile import HEADER
from cellwatt.record.scan import Damage, Scan, scan


@dataclass(frozen=True, slots=True)
class Survey:
    """A file's header, contents and damage; ``closed`` if the file has a valid end."""

    path: Path
    header: Header
    contents: Contents
    damage: tuple[Damage, ...]
    closed: bool
    identity: tuple[int, int]
    """Device and inode, the same under every name."""


def survey_open(file: FileIO, path: Path, *, chunks: bool = True) -> Survey:
    """Survey an open file, damaged or not. Without ``chunks`` the list of chunks may be omitted: much faster.

    A file that was not closed is read to its last whole chunk: an incomplete chunk at its end is no damage.
    Raises ``OSError``, and ``RecordingError`` if the file holds no recording.
    """
    status, summary = os.fstat(file.fileno()), read_summary(file, chunks=chunks)
    if summary is None:
        found = scan(file, path)
    else:
        found = Scan(path, status.st_size, _header(file, summary), summary, closed=True)
    contents = found.contents
    if is_foreign(file, contents, found.header):
        raise ForeignError(f"{path}: not a recording of cellwatt: it has {held(file, contents)}")
    if summary is None and not contents.chunks and found.header is None:
        raise RecordingError(f"{path}: holds no data of a recording")
    header = found.header or guess_header(path, contents)
    sound = found.end if path.name.endswith(PART) else found.size + 1
    # Channels whose declaration is damaged are not read.
    undeclared = (Damage(path, 0, 0, wrong) for wrong in tracks_of(contents.channels)[1])
    damage = (*(d for d in found.damage if d.offset < sound), *undeclared)
    return Survey(path, header, contents, damage, found.closed, (status.st_dev, status.st_ino))


def _header(file: FileIO, contents: Contents) -> Header | None:
    for index in contents.attachments:
        if index.name == HEADER:
            record = read_at(file, min(index.length, LARGEST_RECORD), index.offset)
            try:
                return Header.from_json(parse_attachment(record[RECORD.size :]).data)
            except ValueError:
                return None
    return None


def guess_header(path: Path, contents: Contents) -> Header:
    """Header for a file that lost it: cell and session from the file's name, streams from its channels."""
    streams = streams_of(tracks_of(contents.channels)[0].values())
    name = FileName.parse(path.name) or FileName(contents.start, 0, path.stem)
    return Header(site="", cell=name.cell, session=name.session, number=name.number, streams=streams)


ATTEMPTS = 10
"""Largest number of listings of a folder until two consecutive ones agree."""


def names_in(folder: Path) -> list[str]:
    """Names in a folder, listed until two consecutive listings agree: one may lack a file that is renamed meanwhile."""
    before = _listed(folder)
    for _ in range(ATTEMPTS):
        now = _listed(folder)
        if now == before:
            break
        before = now
    return now


def _listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def open_recording(path: Path) -> tuple[Path, FileIO]:
    """Open a file under its name, or under the name it got when it was closed. Raises ``OSError``."""
    try:
        return path, open_file(path)
    except FileNotFoundError:
        return closed_name(path), open_file(closed_name(path))


def survey(path: Path, *, chunks: bool = True) -> Survey:
    """Survey a file, damaged or not. Without ``chunks`` the list of chunks may be omitted: much faster.

    Raises ``RecordingError`` if the file cannot be opened or holds no recording.
    """
    try:
        found, file = open_recording(path)
        with file:
            return survey_open(file, found, chunks=chunks)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def files_at(places: Sequence[Path]) -> list[Path]:
    """The given recordings, and those in the given folders. Raises ``RecordingError`` if there are none."""
    paths = [path for place in places for path in (in_folder(place) if place.is_dir() else [place])]
    if not paths:
        raise RecordingError(f"{', '.join(map(str, places))}: no recordings (*.mcap) there")
    return paths


def in_folder(folder: Path) -> list[Path]:
    """The recordings in a folder."""
    return [folder / name for name in names_in(folder) if name.endswith((".mcap", f".mcap{PART}"))]


def survey_all(paths: Iterable[Path]) -> tuple[list[Survey], list[Damage]]:
    """Surveys of the readable files, each once. Unreadable files are damage, as long as another is readable.

    Raises ``RecordingError`` if none is.
    """
    surveys: dict[tuple[int, int], Survey] = {}
    damage: list[Damage] = []
    errors: list[RecordingError] = []
    for path in steps(paths, "opening file"):
        try:
            found = survey(path, chunks=False)
            surveys.setdefault(found.identity, found)
        except RecordingError as error:
            errors.append(error)
            damage += _unread(path, error)
    if not surveys:
        raise errors[0]
    return list(surveys.values()), damage


def _unread(path: Path, error: RecordingError) -> list[Damage]:
    """Damage of a file that could not be read; none if its writer has only just created it."""
    if isinstance(error.__cause__, FileNotFoundError):
        return [Damage(path, 0, 0, "was removed before it could be read")]
    try:
        size, regular = path.stat().st_size, path.is_file()
    except OSError:
        size, regular = 0, True
    just_begun = path.name.endswith(PART) and regular and not size
    return [] if just_begun else [Damage(path, 0, size, "it holds no readable data")]


def in_order(surveys: Sequence[Survey], damage: list[Damage]) -> tuple[list[Survey], list[Damage]]:
    """Files ordered by session and number; of copies, the one with most messages."""
    unique: dict[tuple[int, ...], Survey] = {}
    for file in sorted(surveys, key=lambda f: (-f.contents.counts.total(), f.path.name)):
        header, contents = file.header, file.contents
        same = (header.session, header.number) if header.number else (header.session, 0, contents.start, contents.end)
        first = unique.setdefault(same, file)
        if first is not file:
            damage.append(Damage(file.path, 0, 0, f"is a copy of {first.path.name}, not read again"))
    filled = [f for f in unique.values() if f.contents.counts] or list(unique.values())[:1]
    return sorted(filled, key=lambda f: (f.header.session, f.header.number, f.contents.start)), damage


def removed(file: Survey) -> Damage:
    """Damage of a file that was removed after the recording was opened."""
    span = f"{utc(file.contents.start)} to {utc(file.contents.end)}"
    return Damage(file.path, 0, 0, f"was removed while the recording was read; its data are missing: {span}")


def open_until(file: Survey) -> str:
    """Warning about a file that was not closed when the recording was opened."""
    until = f"read up to {utc(file.contents.end)}" if file.contents.counts else "no data yet"
    return f"{file.path.name}: is still being written, or was left open: {until}"


def utc(time: int) -> str:
    """A time in UTC ns for people, to the millisecond."""
    return datetime.fromtimestamp(time // 1_000_000 * 1e-3, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"


def identity_of(file: FileIO) -> tuple[int, int]:
    """Device and inode of an open file: the same under every name."""
    status = os.fstat(file.fileno())
    return status.st_dev, status.st_ino
