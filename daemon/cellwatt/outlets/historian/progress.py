"""Positions of a lake on disk: how far it got, and the file that was about to be written."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, ValidationError

from cellwatt.errors import OutletError, why
from cellwatt.files import read_bytes, replace_bytes
from cellwatt.outlets.historian.recorded import Place, Position

FILE: Final = "historian-lake.json"


class Intent(BaseModel):
    """A file of a table that is about to be written: up to a frame, or up to a result."""

    table: str
    frame: Position | None = None
    result: Place | None = None


class Join(BaseModel):
    """Files in ``folder`` that are about to be joined ``into`` one."""

    folder: str
    names: list[str]
    into: str


class Progress(BaseModel):
    """Position of each table in the lake ``lake``; ``days`` are folders that may have small files."""

    model_config = ConfigDict(extra="forbid")

    lake: str
    frames: Position | None = None
    results: dict[str, Place] = {}
    intent: Intent | None = None
    join: Join | None = None
    days: list[str] = []

    def save(self, folder: Path) -> None:
        """Bring it to disk, whole or not at all. Raises ``OutletError``."""
        try:
            replace_bytes(folder / FILE, self.model_dump_json().encode())
        except OSError as error:
            raise OutletError(f"lake: {folder / FILE} cannot be written: {why(error)}") from error


def load(folder: Path, lake: str) -> Progress | None:
    """The progress of that lake; ``None`` where there is none, or it is not readable. Raises ``OutletError``."""
    try:
        found = Progress.model_validate_json(read_bytes(folder / FILE))
    except (FileNotFoundError, ValidationError):
        return None
    except OSError as error:
        raise OutletError(f"lake: {folder / FILE} cannot be read: {why(error)}") from error
    return found if found.lake == lake else None
