"""One daemon a record folder: who records into it holds a lock, which ends with the process whatever ends it."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from cellwatt.errors import RecordingError

log = logging.getLogger(__name__)

LOCK: Final = ".cellwatt.lock"
_LONGEST = 200  # bytes of what stands in the lock


class Claim:
    """The lock on a folder; it belongs to the process that calls, not to those it forks.

    One of them may die and be begun again, and one that outlives the caller holds up nobody.
    """

    def __init__(self, folder: Path, cell: str) -> None:
        self._folder, self._cell = folder, cell
        self._lock: int | None = None
        self._told = ""

    def take(self) -> None:
        """Hold the folder, made where it is missing. Raises ``RecordingError`` where another process has it.

        Where the file system takes no lock, or is read-only or full, recording goes on without and the log says so.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            # Not by its name but as it is: a file that somebody put in its place must not be opened or changed.
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
            lock = os.open(self._folder / LOCK, flags, 0o640)
            try:
                _take(lock, self._folder, self._cell)
            except BaseException:
                os.close(lock)
                raise
        except OSError as error:
            if self._folder.is_dir():  # otherwise the recorder says why it cannot be made
                log.warning("%s cannot be locked against a second daemon: %s", self._folder, error.strerror)
        else:
            self.release()
            self._lock = lock

    def renew(self) -> None:
        """Hold the folder again if it is another one now: it was removed, moved away or mounted over."""
        if self._lock is None:
            return
        try:
            there, mine = (self._folder / LOCK).stat(), os.fstat(self._lock)
            if os.path.samestat(there, mine):
                return
        except OSError:
            if not self._folder.is_dir():
                return  # the recorder makes it anew
        try:
            self.take()
        except RecordingError as error:
            if str(error) != self._told:
                self._told = str(error)
                log.warning("%s", error)

    def release(self) -> None:
        """Hold nothing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


@contextmanager
def claimed(folder: Path | None, cell: str) -> Iterator[Claim | None]:
    """Hold a folder against others who would record into it; ``None`` holds nothing. Raises as ``Claim.take``."""
    if folder is None:
        yield None
        return
    claim = Claim(folder, cell)
    try:
        claim.take()
        yield claim
    finally:
        claim.release()


def _take(lock: int, folder: Path, cell: str) -> None:
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        holder = os.pread(lock, _LONGEST, 0).decode(errors="replace").strip()
        told = f" ({holder})" if holder and holder.isprintable() else ""
        raise RecordingError(
            f"record.folder {folder} is taken: another cellwatt records into it{told}; stop that one, or give each a "
            "folder of its own"
        ) from error
    os.ftruncate(lock, 0)
    os.pwrite(lock, f"cell {cell}, process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
