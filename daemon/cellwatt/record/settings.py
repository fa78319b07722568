"""Settings of the recorder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from cellwatt.quantity import Bytes, Seconds
from cellwatt.results import Severity


class EvidenceSettings(BaseModel):
    """Evidence packs: what was recorded around an alarm, kept in files of their own, longer than the record."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    severity: Severity | Literal["none"] = "warning"
    """Least severity of the alarms that get a pack: info, warning or error; none for no packs."""
    before: Seconds = 120.0
    """Time in front of the first evidence of the alarm."""
    after: Seconds = 60.0
    """Time behind the raise of the alarm."""
    keep: Bytes = 2e9
    """Disk budget of the packs, beside that of the record; the oldest go first."""
    age: Seconds = 365 * 86400.0
    """Remove packs older than this; 0 keeps them until the budget is spent."""


ROOTS: Final = Path("/var/lib/cellwatt")
"""Where root records, a folder for each cell."""


def default_folder(cell: str) -> Path:
    """Folder of a cell's recordings where the settings name none: one that this user can make.

    That of the systemd unit (``StateDirectory=``), for root ``/var/lib/cellwatt/CELL``, for others
    ``~/.local/state/cellwatt/CELL``, or below ``$XDG_STATE_HOME``. Raises ``ValueError`` for a user without a home.
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
            raise ValueError("this user has no home folder: say where to record, with record: {folder: …}") from error
    return state / "cellwatt" / cell


class RecordSettings(BaseModel):
    """Folder of the record, and the space that it may take."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    folder: Path = Field(default_factory=lambda: default_folder(""))
    """Folder of the recordings; made when missing. Where absent: the ``StateDirectory`` of the systemd unit, for root
    ``/var/lib/cellwatt/CELL``, for others ``~/.local/state/cellwatt/CELL`` (``$XDG_STATE_HOME/cellwatt/CELL``)."""
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
    evidence: EvidenceSettings = EvidenceSettings()
    """Evidence packs of alarms, in the folder ``evidence`` beside the recordings."""

    @property
    def file_limit(self) -> float:
        """Bytes at which a file is closed."""
        return min(self.file_size, self.keep / 4)
