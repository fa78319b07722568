"""Which files make room for new ones: the oldest closed ones, and never the open one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cellwatt.record.header import DAMAGED, FileName, plain_cell
from cellwatt.record.seal import seal_of


@dataclass(frozen=True, slots=True)
class Stored:
    """A file that a budget counts, of ``size`` bytes, last changed at ``modified``, UTC s."""

    path: Path
    size: int
    modified: float
    closed: bool
    """True where it may be removed."""

    @property
    def beside(self) -> tuple[Path, ...]:
        """Files that go with it: its seal."""
        return (seal_of(self.path),)


@dataclass(frozen=True, slots=True)
class Kept(Stored):
    """A file of the recording folder."""

    name: FileName


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
            found.append(Kept(path, status.st_size, status.st_mtime, closed, name))
    return sorted(found, key=lambda k: (k.name, k.path.name))


S = TypeVar("S", bound=Stored)


def surplus(files: Sequence[S], *, keep: float, age: float, now: float, reserve: float) -> list[S]:
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


def remove(files: Iterable[Stored]) -> None:
    """Delete files with what stands beside them. Raises ``OSError``."""
    for file in files:
        for path in (*file.beside, file.path):
            path.unlink(missing_ok=True)


def remove_oldest(folder: Path, cell: str) -> Kept | None:
    """Delete the oldest closed file, whatever the budget says: the disk is full. Raises ``OSError``."""
    oldest = next((f for f in listing(folder, cell) if f.closed), None)
    if oldest is not None:
        remove([oldest])
    return oldest
