"""Finding and opening the files of a recording, also while its cell writes, closes, repairs and removes them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path

from cellwatt.errors import RecordingError
from cellwatt.files import open_file
from cellwatt.progress import steps
from cellwatt.record.header import PART
from cellwatt.record.scan import Damage
from cellwatt.record.summary import Survey, survey_open

ATTEMPTS = 10
"""Listings of a folder until two in a row name the same files."""


def open_recording(path: Path) -> tuple[Path, FileIO]:
    """Open a file under its name, or the one that it has since its writer closed it. Raises ``OSError``.

    A file loses ``.part`` behind its name when it is closed or repaired, and is never renamed back.
    """
    closed = path.with_name(path.name.removesuffix(PART))
    try:
        return path, open_file(path)
    except FileNotFoundError:
        if closed == path:
            raise
        return closed, open_file(closed)


def survey(path: Path, *, chunks: bool = True) -> Survey:
    """Content of a file, damaged or not. Without ``chunks`` they may be left out, which is much faster.

    Raises ``RecordingError`` where the file cannot be opened or nothing in it is a recording.
    """
    try:
        found, file = open_recording(path)
        with file:
            return survey_open(file, found, chunks=chunks)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def in_folder(folder: Path) -> list[Path]:
    """The recordings in a folder: a listing that no rename has disturbed, as far as that can be had."""
    before = _listed(folder)
    for _ in range(ATTEMPTS):
        now = _listed(folder)
        if now == before:
            break
        before = now
    return now


def _listed(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.name.endswith((".mcap", f".mcap{PART}")))


def survey_all(paths: Iterable[Path]) -> tuple[list[Survey], list[Damage]]:
    """Files that can be read, each once. One without anything readable is damage, if others have something.

    Raises ``RecordingError`` where none has.
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
    """What is lost with a file that could not be read: nothing where its writer has just made it."""
    if isinstance(error.__cause__, FileNotFoundError):
        return [Damage(path, 0, 0, "was removed before it could be read")]
    try:
        size, regular = path.stat().st_size, path.is_file()
    except OSError:
        size, regular = 0, True
    just_begun = path.name.endswith(PART) and regular and not size
    return [] if just_begun else [Damage(path, 0, size, "nothing in it can be read")]


def in_order(surveys: Sequence[Survey], damage: list[Damage]) -> tuple[list[Survey], list[Damage]]:
    """Files by session and number; of copies, the one that holds most."""
    kept: dict[tuple[int, ...], Survey] = {}
    for file in sorted(surveys, key=lambda f: (-f.contents.counts.total(), f.path.name)):
        header, contents = file.header, file.contents
        same = (header.session, header.number) if header.number else (header.session, 0, contents.start, contents.end)
        first = kept.setdefault(same, file)
        if first is not file:
            damage.append(Damage(file.path, 0, 0, f"is a copy of {first.path.name}, not read again"))
    filled = [f for f in kept.values() if f.contents.counts] or list(kept.values())[:1]
    return sorted(filled, key=lambda f: (f.header.session, f.header.number, f.contents.start)), damage


def removed(file: Survey) -> Damage:
    """The loss of a file that was removed after it was opened."""
    span = f"{utc(file.contents.start)} to {utc(file.contents.end)}"
    return Damage(file.path, 0, 0, f"was removed while the recording was read; what it held is missing: {span}")


def open_until(file: Survey) -> str:
    """The line about a file that was not closed when it was opened."""
    until = f"read up to {utc(file.contents.end)}" if file.contents.counts else "nothing is in it yet"
    return f"{file.path.name}: is still being written, or was left open: {until}"


def utc(time: int) -> str:
    """A time in UTC ns for people, to the millisecond."""
    return datetime.fromtimestamp(time // 1_000_000 * 1e-3, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"


def identity_of(file: FileIO) -> tuple[int, int]:
    """Device and inode of an open file: the same under every name."""
    status = os.fstat(file.fileno())
    return status.st_dev, status.st_ino
