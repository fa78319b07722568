"""Settings of the recorder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, Literal

from pydantic import Field

from cellwatt.errors import ConfigError
from cellwatt.quantity import Bytes, Seconds
from cellwatt.results import Severity
from cellwatt.section import Section


class EvidenceSettings(Section):
    """Evidence packs: the recording around an alarm, stored in separate files, longer than the record."""

    severity: Severity | Literal["none"] = "warning"
    """Least severity of the alarms that get a pack: info, warning or error; none for no packs."""
    before: Seconds = Field(default=120.0, ge=0)
    """Time before the first evidence of the alarm."""
    after: Seconds = Field(default=60.0, ge=0)
    """Time after the raise of the alarm."""
    keep: Bytes = 2e9
    """Disk budget of the packs, in addition to that of the record; the oldest packs are removed first."""
    age: Seconds = Field(default=365 * 86400.0, ge=0)
    """Age above which packs are removed, 0 for none; the budget limits them too."""


ROOTS: Final = Path("/var/lib/cellwatt")
"""Folder in which root records, with a subfolder for each cell."""


def default_folder(cell: str) -> Path:
    """Default folder of a cell's recordings, which this user can create.

    The systemd unit's (``StateDirectory=``), for root ``/var/lib/cellwatt/CELL``, for others
    ``~/.local/state/cellwatt/CELL``, or below ``$XDG_STATE_HOME``. Raises ``ConfigError`` for a user without a home.
    """
    if unit := os.environ.get("STATE_DIRECTORY"):
        return Path(unit.partition(":")[0])
    if os.geteuid() == 0:
        return ROOTS / cell
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    if not state.is_absolute():
        try:
            state = Path.home() / ".local/state"
        except RuntimeError as error:
            text = "this user has no home folder: set the folder of the recordings, record: {folder: …} or record --out"
            raise ConfigError(text) from error
    return state / "cellwatt" / cell


class RecordSettings(Section):
    """Folder and disk budget of the record."""

    folder: Path = Field(default_factory=lambda: default_folder(""))
    """Folder of the recordings; created if missing. Default: the ``StateDirectory`` of the systemd unit, for root
    ``/var/lib/cellwatt/CELL``, for others ``~/.local/state/cellwatt/CELL`` (``$XDG_STATE_HOME/cellwatt/CELL``)."""
    keep: Bytes = 20e9
    """Disk budget of the folder; the oldest closed files are removed first."""
    age: Seconds = Field(default=0.0, ge=0)
    """Age above which closed files are removed, 0 for none; the budget limits them too."""
    file_size: Bytes = 256e6
    """A file is closed at this size, or at a quarter of ``keep`` if that is less …"""
    file_age: Seconds = Field(default=600.0, ge=0)
    """… or after this time, 0 for none."""
    flush: Seconds = Field(default=0.05, ge=0)
    """Longest time that a sample waits in memory: a killed daemon loses at most this."""
    sync: Seconds = Field(default=1.0, ge=0)
    """Longest time until a sample is synced to disk: a power cut loses at most this."""
    queue: Bytes = 64e6
    """Memory for samples that wait while the disk is slow or full; further samples are dropped and counted."""
    frames: bool = True
    """Record the aligned frames beside the raw samples."""
    evidence: EvidenceSettings = EvidenceSettings()
    """Evidence packs of alarms, in the folder ``evidence`` beside the recordings."""

    @property
    def file_limit(self) -> float:
        """Bytes at which a file is closed."""
        return min(self.file_size, self.keep / 4)
