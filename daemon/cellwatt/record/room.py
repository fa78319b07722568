"""Check that a record folder can be made and written, and that the disk has the room that the settings ask for."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from cellwatt.record.settings import RecordSettings


def troubles(settings: RecordSettings) -> tuple[str, ...]:
    """Obstacles to recording on this PC for the user who asks, a line each; writes nothing."""
    folder = settings.folder.absolute()
    there = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not there.is_dir():
        return (f"folder {folder} cannot be made: {there} is no folder",)
    if not os.access(there, os.W_OK | os.X_OK):
        what = "cannot be written" if there == folder else f"cannot be made in {there}"
        return (f"folder {folder} {what} by user {_user()}: choose another folder, or let that user write there",)
    return tuple(_room(settings, there))


def _room(settings: RecordSettings, there: Path) -> list[str]:
    free = shutil.disk_usage(there).free
    used = sum(file.stat().st_size for file in settings.folder.glob("*.mcap*")) if settings.folder.is_dir() else 0
    if free + used >= settings.keep:
        return []
    return [
        f"folder {settings.folder}: {(free + used) / 1e9:.1f} GB are free or used by recordings, and keep asks for "
        f"{settings.keep / 1e9:.1f} GB: the disk will run full"
    ]


def _user() -> str:
    return os.environ.get("USER") or str(os.geteuid())
