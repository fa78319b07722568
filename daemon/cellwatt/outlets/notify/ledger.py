"""The list of what was told to whom, in a file that outlives a crash: ``notify.jsonl`` beside the recordings.

Every change is a line, written and synced before anything is sent because of it. The file is written anew, and short,
when it is read and when it has grown.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import threading
from collections.abc import Collection
from pathlib import Path
from typing import Final

from cellwatt.errors import why
from cellwatt.files import COMPUTED, read_bytes, replace_bytes
from cellwatt.outlets.notify.told import ENTRY, Entry, Told

log = logging.getLogger(__name__)

FILE: Final = "notify.jsonl"
LARGEST: Final = 4_000_000
"""Bytes beyond which the file is written anew."""


class Ledger:
    """What is known of every recipient, by name. Without a path it is in memory alone."""

    def __init__(self, path: Path | None, largest: int = LARGEST) -> None:
        self.path = path
        self.told: dict[str, Told] = {}
        self.problem: str | None = None
        """Reason why the file does not hold what is known; it is tried again at each change."""
        self.unreadable = 0
        """Lines that no daemon wrote in full."""
        self._largest = largest
        self._size = 0
        self._lines: list[bytes] = []
        self._anew = True
        self._turn = asyncio.Lock()
        self._writing = threading.Lock()

    def read(self) -> None:
        """Read the file, if there is one. Blocks."""
        if self.path is None:
            return
        try:
            content = read_bytes(self.path, COMPUTED)
        except FileNotFoundError:
            return
        except OSError as error:
            self.problem = f"{self.path} cannot be read: {why(error)}"
            return
        for line in content.splitlines():
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            name, plain = json.loads(line)
            entry = ENTRY.validate_python(plain) if isinstance(name, str) else None
        except (ValueError, TypeError, RecursionError):  # the first also of pydantic
            entry = None
        if entry is None:
            self.unreadable += 1
        else:
            self.of(name).apply(entry)

    def of(self, name: str) -> Told:
        """What is known of a recipient."""
        return self.told.setdefault(name, Told())

    def keep(self, names: Collection[str]) -> dict[str, int]:
        """Forget all other recipients; return how many items each of them still waited for."""
        gone = {name: self.told.pop(name) for name in list(self.told) if name not in names}
        self._anew = self._anew or bool(gone)
        lost = {name: len(told.due) + len(told.flight.items if told.flight else ()) for name, told in gone.items()}
        return {name: count for name, count in lost.items() if count}

    def put(self, name: str, entry: Entry) -> None:
        """Take an entry; ``flush`` writes it."""
        told = self.of(name)
        if self.path is not None and told.lasts(entry):
            self._lines.append(_line(name, entry))
        told.apply(entry)

    async def flush(self) -> None:
        """Return once everything put is on disk, or ``problem`` says why it is not."""
        if self.path is None:
            return
        async with self._turn:
            if not self._lines and not self._anew:
                return
            anew = self._anew or self._size > self._largest
            if anew:
                self._lines = [_line(name, told.whole()) for name, told in self.told.items()]
            content, self._lines = b"".join(self._lines), []
            self._anew = False
            work = asyncio.create_task(asyncio.to_thread(self._write, self.path, content, anew))
            try:
                await asyncio.shield(work)
            except asyncio.CancelledError:
                await asyncio.wait([work])  # what is begun is written
                raise

    def _write(self, path: Path, content: bytes, anew: bool) -> None:
        with self._writing:
            try:
                if anew:
                    replace_bytes(path, content, 0o600)
                    self._size = len(content)
                else:
                    append(path, content)
                    self._size += len(content)
            except OSError as error:
                self._anew = True
                problem = f"{path} cannot be written, so a restart may send again: {why(error)}"
                if problem != self.problem:
                    log.warning("%s", problem)
                self.problem = problem
            else:
                self.problem = None


def _line(name: str, entry: Entry) -> bytes:
    return json.dumps([name, ENTRY.dump_python(entry, mode="json")], separators=(",", ":")).encode() + b"\n"


def append(path: Path, content: bytes) -> None:
    """Add to a file that only its owner may read, and sync it."""
    with open(path, "ab", opener=_private) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _private(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
