"""One daemon a record folder: who records into it holds a lock, which ends with the process whatever ends it."""

from __future__ import annotations

import contextlib
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


@contextmanager
def claimed(folder: Path | None, cell: str) -> Iterator[None]:
    """Hold a folder, made where it is missing, against others who would record into it; ``None`` holds nothing.

    The lock belongs to the process that calls, not to those it forks: one of them may die and be begun again, and one
    that outlives the caller holds up nobody. Raises ``RecordingError`` where another process has the folder. Where the
    file system takes no lock, or is read-only or full, recording goes on without and the log says so.
    """
    if folder is None:
        yield
        return
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # Not by its name but as it is: a file that somebody put in its place must not be opened or changed.
            lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o640)
            stack.callback(os.close, lock)
            _take(lock, folder, cell)
        except OSError as error:
            if folder.is_dir():  # otherwise the recorder says why it cannot be made
                log.warning("%s cannot be locked against a second daemon: %s", folder, error.strerror)
        yield


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
