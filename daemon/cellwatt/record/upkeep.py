"""Upkeep of a recording folder: syncing, closing, repairing, making room."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from cellwatt.files import sync_folder
from cellwatt.record.folder import RecordFile, listing, remove, surplus
from cellwatt.record.header import FileName
from cellwatt.record.openfile import DisplacedError, OpenFile, check_place
from cellwatt.record.recovery import Recovery, left_open, recover
from cellwatt.record.settings import RecordSettings

log = logging.getLogger(__name__)

SHORT = 3600.0
"""s for which health reports that recordings were removed because the disk was full."""
MOST_REPORTED = 20
"""Recoveries that health lists, the last ones: a file that cannot be repaired has another one each minute."""
MOST_IN_VAIN = 8
"""Recordings deleted on a full disk without effect before deleting stops."""


def is_full(error: OSError) -> bool:
    """True if deleting recordings may help."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


class Upkeep:
    """Runs slow file work for one recorder, one job at a time, and repairs in parallel; ``now`` is the cell's clock."""

    def __init__(self, settings: RecordSettings, cell: str, session: int, now: Callable[[], int]) -> None:
        self._settings = settings
        self._cell, self._session, self._now = cell, session, now
        self.rotate_at = settings.file_limit
        self._worker = ThreadPoolExecutor(1, "recording-upkeep")
        self._repairs = ThreadPoolExecutor(1, "recording-repair")
        self._syncing: Future[None] | None = None
        self._synced: Path | None = None
        """The file of the last sync."""
        self._repairing: dict[Future[Recovery | None], Path] = {}
        self._left: set[Path] = set()
        self._recovered: list[Recovery] = []
        self._removed_files = self._removed_bytes = 0
        self._in_vain = 0
        self._short: dict[str, Any] = {}
        """Figures of recordings removed because the disk was full, although the budget allowed them."""
        self._short_at = -SHORT
        self._problem = ""

    def start(self) -> None:
        """Repair files that an earlier run left open, newest first, and apply the budget."""
        self._repair(left_open(self._settings.folder, self._cell))
        self.retain()

    def close(self) -> None:
        """Finish the jobs; repairs not yet begun are left to the next start."""
        self._worker.shutdown(wait=True)
        self._repairs.shutdown(wait=True, cancel_futures=True)

    async def recovered(self) -> list[Recovery]:
        """Return the recoveries of the files left open, once all are done."""
        await asyncio.gather(*map(asyncio.wrap_future, self._repairing), return_exceptions=True)
        return list(self._recovered)

    def repairing(self, session: int) -> bool:
        """True while a recording of a session is being repaired, or waits for its repair."""
        names = [FileName.parse(part.name) for done, part in list(self._repairing.items()) if not done.done()]
        return any(name is not None and name.session == session for name in names)

    def stats(self) -> dict[str, Any]:
        """Figures for health messages."""
        return {
            "removed": {"files": self._removed_files, "bytes": self._removed_bytes},
            "recovered": [str(r) for r in self._recovered[-MOST_REPORTED:]],
            "upkeep_problem": self._problem,
            "short": self._short if time.monotonic() - self._short_at < SHORT else {},
        }

    def sync(self, file: OpenFile) -> bool:
        """Start syncing a file to disk; return ``False`` if the last sync is still running.

        Raises the ``OSError`` of the last sync, ``DisplacedError`` if the file was not at its path.
        """
        last, synced = self._syncing, self._synced
        if last is not None and not last.done():
            return False
        self._syncing = None
        # An earlier file that was displaced has been counted when it was closed.
        if last is not None and not (synced != file.part and isinstance(last.exception(), DisplacedError)):
            last.result()
        self._synced = file.part
        self._syncing = self._worker.submit(_sync, file.descriptor(), file.part)
        return True

    def sync_folder(self) -> None:
        """Sync the name of a new file to disk."""
        self._submit(sync_folder, self._settings.folder)

    def publish(self, file: OpenFile) -> None:
        """Sync a finished file to disk under its final name, then apply the budget."""
        self._submit(self._publish, file)

    def retain(self) -> None:
        """Remove closed files beyond the budget or the age."""
        self._submit(self._retain)

    def _submit(self, work: Callable[..., None], *arguments: object) -> None:
        self._worker.submit(work, *arguments).add_done_callback(self._note_failure)

    def _note_failure(self, done: Future[None]) -> None:
        error = done.exception()
        if error is not None:
            log.error("the upkeep of recordings failed", exc_info=error)
            self._problem = f"{self._settings.folder}: {error}"

    def leave(self, part: Path) -> None:
        """Note a file abandoned after a disk error, to be repaired when the disk works."""
        self._left.add(part)

    def repair_left(self) -> None:
        """Repair the abandoned files, because the disk works again."""
        self._in_vain = 0
        self._problem = ""
        remaining, self._left = self._left, set()
        self._repair(sorted(remaining))

    def make_room(self) -> bool:
        """Delete the oldest closed recording, because the disk is full.

        Return ``False`` if there is none, or if no write succeeded after several were deleted: then other files
        fill the disk, and no more recordings are deleted.
        """
        if self._in_vain >= MOST_IN_VAIN:
            self._problem = "the disk stays full although recordings were deleted; other files fill it"
            return False
        self._in_vain += 1
        try:
            files = self._oldest_first()
            gone = [file for file in files if file.closed][:1]
            remove(gone)
        except OSError as error:
            self._problem = f"recordings cannot be deleted to make room: {error.strerror}"
            return False
        if not gone:
            return False
        self._count_removed([gone[0].size])
        remaining = sum(file.size for file in files) - gone[0].size
        if remaining < self._settings.keep:
            self._short_at = time.monotonic()
            self._short = {"files": self._short.get("files", 0) + 1, "bytes": remaining, "keep": self._settings.keep}
        return True

    def _repair(self, parts: Iterable[Path]) -> None:
        waiting = {done: part for done, part in self._repairing.items() if not done.done()}
        self._repairing = waiting | {self._repairs.submit(self._recover, part): part for part in parts}

    def _recover(self, part: Path) -> Recovery | None:
        try:
            recovery = recover(part)
        except Exception as error:
            # No content of a file may stop the daemon or the repair of other files.
            log.exception("%s cannot be repaired", part)
            recovery = Recovery(part, problem=f"cannot be repaired: {error}; it is unchanged")
        if recovery is not None:
            self._recovered.append(recovery)
            if recovery.problem and part.exists():
                self._left.add(part)
        return recovery

    def _publish(self, file: OpenFile) -> None:
        try:
            file.publish()
        except OSError as error:
            self._problem = f"{file.part.name} cannot be closed: {error.strerror}"
            file.release()
            self._left.add(file.part)
        self._retain()

    def _retain(self) -> None:
        settings = self._settings
        try:
            files = self._oldest_first()
            growing = next((f.size for f in reversed(files) if not f.closed), 0)
            reserve = max(self.rotate_at - growing, 0)
            # A PC's clock that leaps ahead while the cell runs makes no recording old.
            now = min(time.time(), self._now() / 1e9)
            gone = surplus(files, keep=settings.keep, age=settings.age, now=now, reserve=reserve)
            remove(gone)
            self._count_removed([f.size for f in gone])
        except OSError as error:
            self._problem = f"old recordings cannot be removed: {error.strerror}"

    def _oldest_first(self) -> list[RecordFile]:
        """The files of the cell in the order in which they are removed.

        Sessions that begin later than this one were recorded before the PC's clock was set back.
        """
        return sorted(listing(self._settings.folder, self._cell), key=lambda file: file.name.session <= self._session)

    def _count_removed(self, sizes: list[int]) -> None:
        self._removed_files += len(sizes)
        self._removed_bytes += sum(sizes)


def _sync(descriptor: int, part: Path) -> None:
    try:
        os.fdatasync(descriptor)
        check_place(descriptor, part)
    finally:
        os.close(descriptor)
