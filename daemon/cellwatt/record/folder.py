"""A record folder: whether it is writable, its lock, its files, and which of them are removed to make room."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import os
import shutil
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, TypeVar

from cellwatt.errors import RecordingError
from cellwatt.record.header import DAMAGED, PART, FileName, closed_name, plain_cell
from cellwatt.record.settings import RecordSettings
from cellwatt.record.survey import names_in

_ADVICE: Final = "choose another folder, or let that user write there"


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Obstacles to recording for the present user: one that prevents a daemon from starting, and warnings."""

    refusal: str = ""
    warnings: tuple[str, ...] = ()


def obstacles(settings: RecordSettings) -> Obstacles:
    """Test the folder of the record, or its nearest existing parent, with an unnamed file, which leaves no trace."""
    folder, there = settings.folder.absolute(), nearest(settings.folder)
    if not there.is_dir():
        return Obstacles(f"folder {folder} cannot be created: {there} is not a folder")
    reason = _tried(there)
    if reason and there != folder:
        return Obstacles(f"folder {folder} cannot be created in {there} by user {_user()} ({reason}): {_ADVICE}")
    if reason:
        return Obstacles(warnings=(f"folder {folder} cannot be written by user {_user()} ({reason}): {_ADVICE}",))
    return Obstacles(warnings=tuple(_space(settings, there)))


def nearest(folder: Path) -> Path:
    """The folder, or its nearest parent that exists."""
    return next(each for each in (folder.absolute(), *folder.absolute().parents) if os.access(each, os.F_OK))


def _tried(folder: Path) -> str:
    """Reason why a file cannot be created and written in a folder; empty if it can."""
    try:
        with TemporaryFile(buffering=0, dir=folder) as file:
            file.write(bytes(4096))
    except OSError as error:
        return str(error.strerror)
    return ""


def _space(settings: RecordSettings, there: Path) -> list[str]:
    free = shutil.disk_usage(there).free
    used = 0
    for file in settings.folder.rglob("*.mcap*"):
        with contextlib.suppress(FileNotFoundError):  # a daemon may close or remove it now
            used += file.stat().st_size
    packs = settings.evidence.keep if settings.evidence.severity != "none" else 0.0
    if free + used >= settings.keep + packs:
        return []
    asked = f"keep allows {settings.keep / 1e9:.1f} GB" + (f", evidence.keep {packs / 1e9:.1f} GB" if packs else "")
    found = f"{(free + used) / 1e9:.1f} GB are free or used by recordings"
    return [f"folder {settings.folder}: {found}, but {asked}: the disk will become full"]


def _user() -> str:
    return os.environ.get("USER") or str(os.geteuid())


log = logging.getLogger(__name__)

YOUNGER: Final = 1_767_225_600.0
"""2026-01-01, UTC s, before the first release: a recording of before was written while the PC's clock was wrong."""
LOCK: Final = ".cellwatt.lock"
_LONGEST = 200  # bytes of the lock's text


@contextmanager
def claimed(folder: Path | None, cell: str) -> Iterator[None]:
    """Lock a folder, created if missing, against other daemons that would record into it; ``None`` locks nothing.

    The lock belongs to the calling process, not to its forks: a fork may die and be restarted, and one that outlives
    the caller does not hold the lock. Raises ``RecordingError`` if another process has the folder. If the file system
    supports no locks, or is read-only or full, recording continues without a lock and the log says so.
    """
    lock = None if folder is None else _lock(folder, cell)
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _lock(folder: Path, cell: str) -> int | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # O_NOFOLLOW, O_NONBLOCK: a link or a FIFO put in its place must not be followed or waited for.
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        lock = os.open(folder / LOCK, flags, 0o640)
        try:
            _take(lock, folder, cell)
        except BaseException:
            os.close(lock)
            raise
    except OSError as error:
        if folder.is_dir():  # otherwise the recorder reports why it cannot be created
            log.warning("%s cannot be locked against a second daemon: %s", folder, error.strerror)
        return None
    return lock


def _take(lock: int, folder: Path, cell: str) -> None:
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        holder = os.pread(lock, _LONGEST, 0).decode(errors="replace").strip()
        remark = f" ({holder})" if holder and holder.isprintable() else ""
        raise RecordingError(
            f"record.folder {folder} is in use: another cellwatt records into it{remark}; stop that one, or give each "
            "its own folder"
        ) from error
    os.ftruncate(lock, 0)
    os.pwrite(lock, f"cell {cell}, process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)


@dataclass(frozen=True, slots=True)
class Stored:
    """A file that counts towards a disk budget, of ``size`` bytes, last changed at ``modified``, UTC s."""

    path: Path
    size: int
    modified: float
    closed: bool
    """True if the file may be removed."""


@dataclass(frozen=True, slots=True)
class RecordFile(Stored):
    """A file of the recording folder."""

    name: FileName


def listing(folder: Path, cell: str) -> list[RecordFile]:
    """The files of one cell, oldest first; files with other names are never touched."""
    found, cell = dict[Path, RecordFile](), plain_cell(cell)
    for listed in names_in(folder) if folder.is_dir() else ():
        name = FileName.parse(listed)
        if name is None or name.cell != cell:
            continue
        there = folder / listed
        for path in (there, closed_name(there)) if listed.endswith(PART) else (there,):  # it may be closed meanwhile
            with contextlib.suppress(FileNotFoundError):
                status = path.stat()
                closed = path.suffix in (".mcap", DAMAGED)
                found[path] = RecordFile(path, status.st_size, status.st_mtime, closed, name)
                break
    return sorted(found.values(), key=lambda k: (k.name.session, k.name.number, k.path.name))


def files_of(folder: Path, cell: str) -> list[RecordFile]:
    """Recordings of a cell in the order in which they were recorded."""
    return [stored for stored in listing(folder, cell) if stored.path.name.endswith((".mcap", f".mcap{PART}"))]


S = TypeVar("S", bound=Stored)


def surplus(files: Sequence[S], *, keep: float, age: float, now: float, reserve: float) -> list[S]:
    """Files to remove, oldest first, so that the others and ``reserve`` bytes more fit into ``keep`` bytes.

    Closed files last written more than ``age`` s before ``now`` (UTC s) are included, unless ``age`` is 0 or they were
    written by a PC that had no clock yet.
    """
    total = sum(f.size for f in files) + reserve
    gone = []
    for file in files:
        if not file.closed:
            continue
        if total > keep or (age and file.modified > YOUNGER and now - file.modified > age):
            gone.append(file)
            total -= file.size
    return gone


def remove(files: Iterable[Stored]) -> None:
    """Delete files. Raises ``OSError``."""
    for file in files:
        file.path.unlink(missing_ok=True)
