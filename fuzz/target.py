"""What a fuzzing target is."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path


@dataclass(frozen=True)
class Target:
    """One reader of bytes of others.

    ``run`` reads an input of up to ``longest`` bytes and returns whatever the input is: it takes the errors that the
    reader documents for itself, and any other that leaves it is a finding, as is a property (``assert``) that does not
    hold. ``seeds`` are inputs to begin with, made by the project's own encoders or from worked bytes.
    """

    run: Callable[[bytes], None]
    seeds: Callable[[], Iterable[bytes]]
    longest: int = 4096


@cache
def folder() -> Path:
    """A folder of this process for readers that want a path; in memory where the system has a place for that."""
    memory = Path("/dev/shm")
    made = tempfile.TemporaryDirectory(prefix="cellwatt-fuzz-", dir=memory if memory.is_dir() else None)
    _folders.append(made)
    return Path(made.name)


_folders: list[tempfile.TemporaryDirectory[str]] = []
"""Removed when the process ends."""


def clear() -> None:
    """Remove the folder now; the next reader that wants one gets another."""
    folder.cache_clear()
    while _folders:
        _folders.pop().cleanup()
