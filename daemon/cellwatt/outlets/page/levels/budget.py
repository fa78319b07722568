"""The bytes that level files may take: those of the oldest recordings go first."""

from __future__ import annotations

import os
from operator import itemgetter
from pathlib import Path

from cellwatt.outlets.page.levels import level_file
from cellwatt.record.header import FileName, plain_cell


class Budget:
    """Holds the level files of ``cell`` in the folder of the recordings below ``most`` bytes."""

    def __init__(self, folder: Path, cell: str, most: float) -> None:
        self._folder, self._cell, self._most = folder / level_file.FOLDER, plain_cell(cell), most
        self._oldest: tuple[int, int] | None = None
        """Session and number of the newest recording whose file went."""

    def allows(self, recording: FileName) -> bool:
        """False for a recording that is as old as one whose file went, or older."""
        return self._oldest is None or (recording.session, recording.number) > self._oldest

    def files(self) -> list[tuple[FileName, os.DirEntry[str]]]:
        """Level files of the cell by the names of their recordings. Raises ``OSError``."""
        try:
            with os.scandir(self._folder) as entries:
                named = [(level_file.recording_of(Path(entry.name)), entry) for entry in entries]
        except FileNotFoundError:
            return []
        return [(name, entry) for name, entry in named if name is not None and name.cell == self._cell]

    def hold(self) -> int:
        """Remove what is too much; return the number of files that went. Raises ``OSError``."""
        there = sorted((((n.session, n.number), entry) for n, entry in self.files()), key=itemgetter(0))
        total, gone = sum(_size(entry) for _, entry in there), 0
        for age, entry in there:
            if total <= self._most:
                break
            total -= _size(entry)
            Path(entry.path).unlink(missing_ok=True)
            self._oldest, gone = age, gone + 1
        return gone


def _size(entry: os.DirEntry[str]) -> int:
    try:
        return entry.stat().st_size
    except FileNotFoundError:
        return 0
