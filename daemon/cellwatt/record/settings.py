"""Settings of the recorder."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from cellwatt.quantity import Bytes, Seconds


class RecordSettings(BaseModel):
    """Folder of the record, and the space that it may take."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    folder: Path
    """Folder of the recordings; made when missing."""
    keep: Bytes = 20e9
    """Disk budget of the folder; the oldest closed files go first."""
    age: Seconds = 0.0
    """Remove closed files older than this; 0 keeps them until the budget is spent."""
    file_size: Bytes = 256e6
    """A file is closed at this size, or at a quarter of ``keep`` where that is less …"""
    file_age: Seconds = 600.0
    """… or after this time."""
    flush: Seconds = 0.05
    """Longest time a sample waits in memory: what a killed daemon may lose."""
    sync: Seconds = 1.0
    """Longest time a sample waits for the disk itself: what a power cut may lose."""
    queue: Bytes = 64e6
    """Memory for what waits while the disk is slow or full; what finds no room in it is dropped and counted."""
    frames: bool = True
    """Record the aligned frames beside the raw samples."""
    sign: Path | None = None
    """Private key (Ed25519, PEM) that signs each finished file, in ``NAME.mcap.sig`` beside it."""
