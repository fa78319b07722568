"""Finds the recordings of many cells in one folder, with the cell, the kind of robot and the week of each."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from cellwatt.errors import CellwattError, ConfigError, RecordingError
from cellwatt.record import Recording
from cellwatt.record.header import PART, FileName
from cellwatt.record.packs import FOLDER as EVIDENCE
from cellwatt.tables import read_table
from cellwatt_plugins.robot.description import RobotDescription, load_robot, robot_file

MONDAY: Final = date(1970, 1, 5)
"""First day of week 0."""
TABLES: Final = (".parquet", ".csv")
RESULTS: Final = ("alarms", "tasks", "energies")
"""Tables of results in the historian's lake, which are not recordings."""
UTC_SECONDS: Final = 1e9
"""Smallest time, s, that counts from 1970; a smaller one counts from the start of its recording."""
_DAY = re.compile(r"(?<!\d)(20\d\d)-?([01]\d)-?([0-3]\d)(?!\d)")


@dataclass(frozen=True)
class CellWeek:
    """Recordings of one cell in one ``week``, counted from ``MONDAY``; ``robot`` is the cell's description."""

    cell: str
    robot: Path
    week: int
    files: tuple[Path, ...]


@dataclass(frozen=True)
class Skipped:
    """A recording that is not used, and why."""

    cell: str
    place: str
    why: str

    @classmethod
    def of(cls, cell: str, path: Path, error: CellwattError) -> Skipped:
        """A file that is not used because of an error."""
        return cls(cell, str(path), str(error).removeprefix(f"{path}: "))


@dataclass(frozen=True)
class Lake:
    """Content of a folder: weeks, sorted by cell and week, and the robot's description by cell."""

    weeks: Sequence[CellWeek]
    robots: dict[str, RobotDescription]
    skipped: Sequence[Skipped]


def monday(week: int) -> date:
    """Return the first day of a week."""
    return MONDAY + timedelta(days=7 * week)


def week_of(day: date) -> int:
    """Return the week of a day."""
    return (day - MONDAY).days // 7


def find(lake: Path, robots: Sequence[str] = (), last: int | None = None) -> Lake:
    """Find the recordings of a lake, in its ``last`` weeks or in all.

    ``robots`` are descriptions as ``[CELLS=]FILE``; the first that matches is used, or else the nearest robot.yaml
    above the recording. Raises ``RecordingError`` if there are no recordings, ``ConfigError`` if a description is
    missing or wrong.
    """
    folders = {path: _folder(path, lake) for path in sorted(lake.rglob("*")) if _is_recording(path, lake)}
    every = _cells(folders, lake)
    cells = {path: cell for path, cell in every.items() if cell}
    if not cells:
        raise RecordingError(
            f"{lake}: no recordings in this folder: put .mcap, .parquet or .csv into a folder for each cell"
        )
    given = [_pattern(text) for text in robots]
    robot_of = {cell: _robot(cell, folders[path], lake, given) for path, cell in cells.items()}
    described = {path: load_robot(path) for path in dict.fromkeys(robot_of.values())}
    _one_each(described)
    weeks: dict[tuple[str, int], list[Path]] = {}
    skipped = [Skipped("no cell", str(path), "it is not in a cell's folder") for path in every if path not in cells]
    for path, cell in cells.items():
        try:
            weeks.setdefault((cell, week_of(_day(path))), []).append(path)
        except CellwattError as error:
            skipped.append(Skipped.of(cell, path, error))
    first = 0 if last is None else max((week for _, week in weeks), default=0) - last + 1
    found = [CellWeek(c, robot_of[c], w, tuple(paths)) for (c, w), paths in sorted(weeks.items()) if w >= first]
    return Lake(found, {cell: described[path] for cell, path in sorted(robot_of.items())}, skipped)


def _is_recording(path: Path, lake: Path) -> bool:
    parts = path.relative_to(lake).parts
    if any(part.startswith(".") or part == EVIDENCE for part in parts) or parts[0] in RESULTS:
        return False
    return path.suffix in TABLES or path.name.endswith((".mcap", f".mcap{PART}"))


def _folder(path: Path, lake: Path) -> Path:
    """The folder of a recording's cell, above folders named after a day."""
    folder = path.parent
    while folder != lake and (folder.name.startswith("day=") or _DAY.fullmatch(folder.name)):
        folder = folder.parent
    return folder


def _cells(folders: Mapping[Path, Path], lake: Path) -> dict[Path, str]:
    """Cell of each recording, named after its folder, or after the path if two folders have the same name."""
    names = {folder: unquote(folder.name.partition("cell=")[2] or folder.name) for folder in folders.values()}
    names.pop(lake, None)
    count = Counter(names.values())
    names = {f: name if count[name] == 1 else f.relative_to(lake).as_posix() for f, name in names.items()}
    alone = {path: FileName.parse(path.name) for path, folder in folders.items() if folder == lake}
    own = {path: parsed.cell for path, parsed in alone.items() if parsed is not None}
    return {path: own.get(path, names.get(folder, "")) for path, folder in folders.items()}


def _pattern(text: str) -> tuple[str, Path]:
    """Cells and description of ``[CELLS=]FILE``; the longest FILE that exists, as folders are named ``site=…``."""
    parts = text.split("=")
    files = ["=".join(parts[i:]) for i in range(len(parts))]
    file = next((file for file in files if Path(file).exists()), files[-1])
    return text.removesuffix(file).removesuffix("=") or "*", robot_file(file).absolute()


def _robot(cell: str, folder: Path, lake: Path, given: Sequence[tuple[str, Path]]) -> Path:
    above = [each / "robot.yaml" for each in (folder, *folder.parents) if each.is_relative_to(lake)]
    found = [path for pattern, path in given if fnmatchcase(cell, pattern)] + [path for path in above if path.exists()]
    if not found:
        raise ConfigError(
            f"cell {cell}: no description of its robot: give --robot '{cell}=FILE', or put a robot.yaml into {folder} "
            "or a folder above it"
        )
    return found[0]


def _one_each(described: dict[Path, RobotDescription]) -> None:
    """Raise ``ConfigError`` if two descriptions with the same name differ."""
    seen: dict[str, tuple[Path, RobotDescription]] = {}
    for path, robot in described.items():
        other, same = seen.setdefault(robot.robot, (path, robot))
        if same.model_copy(update={"urdf": robot.urdf}) != robot:
            raise ConfigError(
                f"{path}: is called {robot.robot} like {other}, but differs from it: give it another name"
            )


def _day(path: Path) -> date:
    """Day on which a recording began, from its name, its folder's name or its content. Raises ``CellwattError``."""
    if ".mcap" in path.suffixes:  # its name has the start of the daemon, which may be weeks earlier
        return datetime.fromtimestamp(Recording.open(path).start / 1e9, UTC).date()
    for name in (path.name, path.parent.name):
        if (match := _DAY.search(name)) is not None:
            try:
                return date(*map(int, match.groups()))
            except ValueError:
                continue
    time = float(read_table(path).time[0])
    if not UTC_SECONDS < time < 1e11:
        raise RecordingError(f"{path}: no date: neither in its name (2026-01-31) nor in its time")
    return datetime.fromtimestamp(time, UTC).date()
