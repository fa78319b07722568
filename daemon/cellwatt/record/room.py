"""Check that a record folder can be made and written, and that the disk has the room that the settings ask for."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cellwatt.record.settings import RecordSettings

_ADVICE: Final = "choose another folder, or let that user write there"
_UNKNOWN: Final = (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL)
"""Answers of file systems that know no files without a name."""
_BLOCK: Final = bytes(4096)


@dataclass(frozen=True, slots=True)
class Room:
    """Obstacles to recording on this PC for the user who asks: one that keeps a daemon from starting, and warnings."""

    refusal: str = ""
    warnings: tuple[str, ...] = ()


def room(settings: RecordSettings) -> Room:
    """Try the folder of the record, or the nearest one above it, by a file without a name: it leaves no trace."""
    folder = settings.folder.absolute()
    there = next(parent for parent in (folder, *folder.parents) if os.access(parent, os.F_OK))
    if not there.is_dir():
        return Room(f"folder {folder} cannot be made: {there} is no folder")
    reason = _tried(there)
    if reason and there != folder:
        return Room(f"folder {folder} cannot be made in {there} by user {_user()} ({reason}): {_ADVICE}")
    if reason:
        return Room(warnings=(f"folder {folder} cannot be written by user {_user()} ({reason}): {_ADVICE}",))
    return Room(warnings=tuple(_space(settings, there)))


def _tried(folder: Path) -> str:
    """Reason for which a file cannot be made and written in a folder; empty if it can."""
    if not os.access(folder, os.W_OK | os.X_OK):
        return os.strerror(errno.EROFS if os.statvfs(folder).f_flag & os.ST_RDONLY else errno.EACCES)
    try:
        file = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            os.write(file, _BLOCK)
        finally:
            os.close(file)
    except OSError as error:
        return "" if error.errno in _UNKNOWN else str(error.strerror)
    return ""


def _space(settings: RecordSettings, there: Path) -> list[str]:
    free = shutil.disk_usage(there).free
    used = sum(file.stat().st_size for file in settings.folder.rglob("*.mcap*")) if settings.folder.is_dir() else 0
    packs = settings.evidence.keep if settings.evidence.severity != "none" else 0.0
    if free + used >= settings.keep + packs:
        return []
    asked = f"keep asks for {settings.keep / 1e9:.1f} GB" + (
        f", evidence.keep for {packs / 1e9:.1f} GB" if packs else ""
    )
    found = f"{(free + used) / 1e9:.1f} GB are free or used by recordings"
    return [f"folder {settings.folder}: {found}, and {asked}: the disk will run full"]


def _user() -> str:
    return os.environ.get("USER") or str(os.geteuid())
