"""Evidence packs as files: their names, the packs due, and the packs stored.

A pack is ``<cell>_<time of the alarm, UTC>_<id of the alarm>.mcap`` in the folder ``evidence`` of the record, with a
page (``.html``) beside it. A pack that is due is noted in a file with the suffix ``.due``, so that the next daemon cuts
it if this one is killed.
"""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from cellwatt.alarms import SEVERITIES
from cellwatt.files import WRITTEN, read_bytes, replace_bytes
from cellwatt.record.folder import Stored, remove, surplus
from cellwatt.record.header import plain_cell
from cellwatt.record.settings import EvidenceSettings
from cellwatt.results import Alarm

FOLDER: Final = "evidence"
DUE: Final = ".due"
MOST_ALARMS: Final = 100
"""Largest number of alarms that a pack lists; more are counted."""
_LONGEST: Final = 80
"""Largest number of characters of an alarm's id in a file's name."""
_NAME = re.compile(r"(?P<cell>.+)_\d{8}T\d{6}_\d{3}Z_.+\.mcap")


@dataclass(frozen=True, slots=True)
class Due:
    """A pack to be cut: ``name`` without suffix, span in UTC ns, and its alarms; the first gave the name.

    ``latest`` is the latest possible ``end``, ``more`` the number of alarms beyond those listed.
    """

    name: str
    cell: str
    start: int
    end: int
    latest: int
    alarms: tuple[Alarm, ...]
    more: int = 0

    @classmethod
    def of(cls, cell: str, alarm: Alarm, settings: EvidenceSettings) -> Due:
        """The pack for a raised alarm."""
        before, after = round(settings.before * 1e9), round(settings.after * 1e9)
        # Evidence from long ago is left out, or the pack would be as long as the record.
        start = max(alarm.since, alarm.time - before) - before
        end = alarm.time + after
        return cls(name_of(cell, alarm), cell, start, end, end + before, (alarm,))

    def joined(self, alarm: Alarm, settings: EvidenceSettings) -> Due | None:
        """The pack extended by one more alarm and its time after; ``None`` if the pack would become too long."""
        end = max(self.end, alarm.time + round(settings.after * 1e9))
        if alarm.time < self.start or alarm.time > self.end or end > self.latest:
            return None
        if len(self.alarms) < MOST_ALARMS:
            return replace(self, end=end, alarms=(*self.alarms, alarm))
        return replace(self, end=end, more=self.more + 1)


_DUE: TypeAdapter[Due] = TypeAdapter(Due)


def name_of(cell: str, alarm: Alarm) -> str:
    """A pack's name without suffix, safe as a file name for any alarm id."""
    stamp = datetime.fromtimestamp(alarm.time // 1_000_000_000, UTC).strftime("%Y%m%dT%H%M%S")
    plain = re.sub(r"[^\w.-]+", "-", alarm.id, flags=re.ASCII)[:_LONGEST] or "alarm"
    return f"{plain_cell(cell)}_{stamp}_{alarm.time // 1_000_000 % 1000:03d}Z_{plain}"


def wants(settings: EvidenceSettings, alarm: Alarm) -> bool:
    """True for an alarm that gets a pack."""
    if settings.severity == "none" or not alarm.active:
        return False
    return SEVERITIES.index(alarm.severity) >= SEVERITIES.index(settings.severity)


def write_due(folder: Path, due: Due) -> None:
    """Write the note of a pack that is due. Raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    replace_bytes(due_path(folder, due), _DUE.dump_json(due, fallback=str))


def read_due(path: Path) -> Due:
    """Read the note of a pack that is due. Raises ``OSError``, and ``ValueError`` if the file is damaged."""
    due = _DUE.validate_json(read_bytes(path, WRITTEN))
    if Path(due.name).name != due.name or not due.alarms:
        raise ValueError(f"{path} does not name a pack")
    return due


def due_path(folder: Path, due: Due) -> Path:
    """Path of the note of a pack that is due."""
    return folder / f"{due.name}{DUE}"


def all_due(folder: Path, cell: str) -> list[Due]:
    """The packs of a cell that are due, oldest first; damaged notes are removed. Raises ``OSError``."""
    found = []
    for path in sorted(folder.glob(f"*{DUE}")):
        try:
            due = read_due(path)
        except ValueError:
            path.unlink(missing_ok=True)
            continue
        if due.cell == cell:
            found.append(due)
    return found


def page_of(pack: Path) -> Path:
    """Path of a pack's page."""
    return pack.with_suffix(".html")


def listing(folder: Path, cell: str) -> list[Stored]:
    """The packs of one cell, oldest first, each with the size of its page; files with other names are never touched."""
    found = []
    for path in folder.iterdir() if folder.is_dir() else ():
        match = _NAME.fullmatch(path.name)
        if match is None or match["cell"] != plain_cell(cell):
            continue
        with contextlib.suppress(FileNotFoundError):
            status, page = path.stat(), page_of(path)
            size = status.st_size + (page.stat().st_size if page.exists() else 0)
            found.append(Stored(path, size, status.st_mtime, closed=True))
    return sorted(found, key=lambda p: p.path.name)


def retain(folder: Path, cell: str, settings: EvidenceSettings, now: float) -> list[Stored]:
    """Remove packs beyond budget and age, with their pages; return the others. ``now`` UTC s. Raises ``OSError``."""
    packs = listing(folder, cell)
    gone = surplus(packs, keep=settings.keep, age=settings.age, now=now, reserve=0.0)
    for pack in gone:
        page_of(pack.path).unlink(missing_ok=True)
    remove(gone)
    return [pack for pack in packs if pack not in gone]
