"""Which files make room for new ones: the oldest closed ones, and never the open one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from cellwatt.record.header import DAMAGED, FileName, plain_cell
from cellwatt.record.seal import seal_of


@dataclass(frozen=True, slots=True)
class Kept:
    """A file of the recording folder: ``modified`` UTC s; ``closed`` where it may be removed."""

    path: Path
    name: FileName
    size: int
    modified: float
    closed: bool


def listing(folder: Path, cell: str) -> list[Kept]:
    """The files of one cell, oldest first; files with other names are not ours and never touched."""
    found = []
    for path in folder.iterdir() if folder.is_dir() else ():
        name = FileName.parse(path.name)
        if name is None or name.cell != plain_cell(cell):
            continue
        with contextlib.suppress(FileNotFoundError):
            status = path.stat()
            closed = path.suffix in (".mcap", DAMAGED)
            found.append(Kept(path, name, status.st_size, status.st_mtime, closed))
    return sorted(found, key=lambda k: (k.name, k.path.name))


class Removable(Protocol):
    """What a budget counts: a size in bytes, the time of its last change in UTC s, and true where it may go."""

    @property
    def size(self) -> int:
        """Bytes."""
        ...

    @property
    def modified(self) -> float:
        """UTC s."""
        ...

    @property
    def closed(self) -> bool:
        """True where it may go."""
        ...


R = TypeVar("R", bound=Removable)


def surplus(files: Sequence[R], *, keep: float, age: float, now: float, reserve: float) -> list[R]:
    """Files to remove, oldest first, so that all files and ``reserve`` bytes more fit into ``keep`` bytes.

    Closed files last written more than ``age`` s before ``now`` (UTC s) go as well; 0 keeps them.
    """
    total = sum(f.size for f in files) + reserve
    gone = []
    for file in files:
        if not file.closed:
            continue
        if total > keep or (age and now - file.modified > age):
            gone.append(file)
            total -= file.size
    return gone


def remove(files: Iterable[Kept]) -> int:
    """Delete files; gives the bytes freed. Raises ``OSError``."""
    freed = 0
    for file in files:
        file.path.unlink(missing_ok=True)
        seal_of(file.path).unlink(missing_ok=True)
        freed += file.size
    return freed


def remove_oldest(folder: Path, cell: str) -> Kept | None:
    """Delete the oldest closed file, whatever the budget says: the disk is full. Raises ``OSError``."""
    oldest = next((f for f in listing(folder, cell) if f.closed), None)
    if oldest is not None:
        remove([oldest])
    return oldest
