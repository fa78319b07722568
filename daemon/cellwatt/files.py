"""Opens files of other programs and people if they are regular files within a size limit.

A FIFO would block its reader for ever, opening a device file may have effects, and a file of 10 GB fills the memory.
So every file that a command or the daemon reads is checked here, also those that a library opens by name.
"""

from __future__ import annotations

import csv
import errno
import io
import logging
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import Final, TypeVar

from cellwatt.errors import CellwattError, why

log = logging.getLogger(__name__)

T = TypeVar("T")
Place = str | os.PathLike[str]
Places = Place | Iterable[Place]

WRITTEN: Final = 16_000_000
"""Largest size in bytes of files that a person or their tool wrote: descriptions of robots and meters, URDF, notes."""
COMPUTED: Final = 1_000_000_000
"""Largest size in bytes of computed files: tables, references, networks."""


def paths_of(places: Places) -> list[Path]:
    """Paths of one file or folder, or of several."""
    return [Path(p) for p in ([places] if isinstance(places, str | os.PathLike) else places)]


class UnfitFileError(OSError):
    """The path is not a readable regular file; the text is the reason alone."""

    def __init__(self, reason: str) -> None:
        super().__init__(0, reason)  # not an errno of the system, which has its own text

    def __str__(self) -> str:
        return str(self.strerror)


_KINDS = (
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def check_file(path: Path, limit: int | None = COMPUTED) -> None:
    """Raise ``OSError`` with a plain reason unless ``path`` is a regular file of at most ``limit`` bytes."""
    _check(path.stat(), limit)


def open_file(path: Path, limit: int | None = None, *, write: bool = False) -> FileIO:
    """Open a regular file of at most ``limit`` bytes to read it (``write``: also to change it).

    Raises ``OSError`` with a plain reason; ``ValueError`` if the name holds a NUL.
    """
    check_file(path, limit)  # opening some devices has effects

    def opener(name: str, flags: int) -> int:
        return os.open(name, flags | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)

    file = FileIO(path, "rb+" if write else "rb", opener=opener)
    try:
        _check(os.fstat(file.fileno()), limit)  # the path may name another file by now
    except OSError:
        file.close()
        raise
    return file


def read_bytes(path: Path, limit: int = WRITTEN) -> bytes:
    """Read a regular file of at most ``limit`` bytes. Raises ``OSError`` with a plain reason."""
    with open_file(path, limit) as file:
        content, remaining = bytearray(), limit + 1
        while remaining and (piece := file.read(min(remaining, 1 << 20))):  # the file may grow while it is read
            content += piece
            remaining -= len(piece)
    if not remaining:
        raise _too_large(limit)
    return bytes(content)


def read_text(path: Path, limit: int = WRITTEN) -> str:
    """Like ``read_bytes``, as UTF-8. Raises ``UnicodeDecodeError`` as well."""
    return read_bytes(path, limit).decode("utf-8")


def read_saved(path: Path, parse: Callable[[bytes], T], lost: str) -> T | None:
    """What ``parse`` makes of a file that an earlier process saved; ``None`` if there is none, or it cannot be read.

    The latter is logged, with what is ``lost`` by it.
    """
    try:
        return parse(read_bytes(path))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        reason = why(error) if isinstance(error, OSError) else "its content is not valid"
        log.warning("%s cannot be read, %s: %s", path, lost, reason)
        return None


def unreadable(named: Mapping[str, Path | None]) -> Iterator[str]:
    """One line for each unreadable file of ``named``, which maps options to the paths that the user gave."""
    for option, path in named.items():
        if path is not None:
            try:
                open_file(path, WRITTEN).close()
            except OSError as error:
                yield f"{option}: {path} cannot be read: {error.strerror}"


def make_folder(folder: Path) -> None:
    """Create the output folder of a command. Raises ``CellwattError`` with a plain reason."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CellwattError(f"{folder} cannot be created: {why(error)}") from error


def write_file(path: Path, content: str | bytes) -> None:
    """Write an output file of a command; create its folder. Raises ``CellwattError`` with a plain reason."""
    try:
        if not path.parent.exists():
            path.parent.mkdir(parents=True)
        path.write_bytes(content.encode(errors="replace") if isinstance(content, str) else content)
    except OSError as error:
        raise CellwattError(f"{path} cannot be written: {why(error)}") from error


def write_csv(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows as CSV, as ``write_file``."""
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    write_file(path, text.getvalue())


def replace_text(path: Path, text: str) -> None:
    """Replace the content of a file by a text, as ``replace_bytes``. Raises ``OSError``."""
    replace_bytes(path, text.encode())


def replace_bytes(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Replace the content of a file atomically, and sync the file and its name to disk. Raises ``OSError``.

    ``mode``: permissions of the file, before the umask.
    """
    part = path.with_name(f"{path.name}.part")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW
    with FileIO(os.open(part, flags, mode), "wb") as file:
        write_all(file, content)
        os.fsync(file.fileno())
    part.replace(path)
    sync_folder(path.parent)


def write_all(file: FileIO, content: bytes) -> None:
    """Write all bytes, in as many calls as the system needs. Raises ``OSError``."""
    view = memoryview(content)
    while view:
        view = view[file.write(view) :]


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to disk, unless its file system cannot (VirtualBox). Raises ``OSError``."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)


def put_aside(path: Path, content: bytes, largest: int, mode: int = 0o600) -> bool:
    """Append to a file and sync it; if it would exceed ``largest`` bytes, first rename it to ``.1``.

    Return True if that replaced an older ``.1``. Raises ``OSError``. Blocks.
    """
    replaced = False
    if path.exists() and path.stat().st_size + len(content) > largest:
        old = path.with_name(f"{path.name}.1")
        replaced = old.exists()
        path.replace(old)
    flags = os.O_CLOEXEC | os.O_NOFOLLOW
    with open(path, "ab", opener=lambda name, how: os.open(name, how | flags, mode)) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return replaced


def _check(status: os.stat_result, limit: int | None) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(status.st_mode)), "something else")
        raise UnfitFileError(f"{kind}, expected a file")
    if limit is not None and status.st_size > limit:
        raise _too_large(limit)


def _too_large(limit: int) -> UnfitFileError:
    return UnfitFileError(f"larger than {limit:,} bytes")
