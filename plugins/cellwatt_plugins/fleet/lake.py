"""Recordings of many cells in one folder: of which cell, of which kind of robot, of which week."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from cellwatt.errors import CellwattError, ConfigError, RecordingError
from cellwatt.record import Recording
from cellwatt.record.header import FileName
from cellwatt.tables import read_table
from cellwatt_plugins.robot.description import RobotDescription, load_robot, robot_file

MONDAY: Final = date(1970, 1, 5)
"""First day of week 0."""
TABLES: Final = (".parquet", ".csv")
RESULTS: Final = ("alarms", "tasks", "energies")
"""Tables that the historian's lake holds beside the frames."""
UTC_SECONDS: Final = 1e9
"""A time column from here on counts from 1970; below, from the begin of its recording."""
_DAY = re.compile(r"(?<!\d)(20\d\d)-?([01]\d)-?([0-3]\d)(?!\d)")


@dataclass(frozen=True)
class CellWeek:
    """Recordings of one cell in one week."""

    cell: str
    robot: Path
    """Its description."""
    week: int
    """Weeks since ``MONDAY``."""
    files: tuple[Path, ...]


@dataclass(frozen=True)
class Skipped:
    """A recording, or a part of it, that is left out."""

    cell: str
    place: str
    why: str


@dataclass(frozen=True)
class Lake:
    """All that is in a folder."""

    weeks: Sequence[CellWeek]
    """By cell and week."""
    robots: dict[str, RobotDescription]
    """Description by cell."""
    skipped: Sequence[Skipped]


@dataclass(frozen=True)
class _File:
    path: Path
    folder: Path
    """Of its cell."""
    cell: str


def monday(week: int) -> date:
    """Return the first day of a week."""
    return MONDAY + timedelta(days=7 * week)


def week_of(day: date) -> int:
    """Return the week of a day."""
    return (day - MONDAY).days // 7


def find(lake: Path, robots: Sequence[str] = (), last: int | None = None) -> Lake:
    """Find the recordings of a lake, of its ``last`` weeks or of all.

    ``robots`` are descriptions as ``[CELLS=]FILE``, the first that fits counts; where none does, the nearest
    robot.yaml above the recording. Raises ``RecordingError`` where there is none, ``ConfigError`` where a description
    is missing or wrong.
    """
    files = _named(list(_files(lake)), lake)
    if not files:
        raise RecordingError(f"{lake}: no recordings there: put .mcap, .parquet or .csv into a folder for each cell")
    given = [_pattern(text) for text in robots]
    robot_of = {file.cell: _robot(file, lake, given) for file in files}
    described = {path: load_robot(path) for path in dict.fromkeys(robot_of.values())}
    _one_each(described)
    weeks: dict[tuple[str, int], list[Path]] = {}
    skipped = []
    for file in files:
        try:
            weeks.setdefault((file.cell, week_of(_day(file.path))), []).append(file.path)
        except CellwattError as error:
            skipped.append(Skipped(file.cell, str(file.path), str(error).removeprefix(f"{file.path}: ")))
    first = 0 if last is None else max((week for _, week in weeks), default=0) - last + 1
    found = [CellWeek(c, robot_of[c], w, tuple(paths)) for (c, w), paths in sorted(weeks.items()) if w >= first]
    return Lake(found, {cell: described[path] for cell, path in sorted(robot_of.items())}, skipped)


def _files(lake: Path) -> Iterator[_File]:
    """Recordings in order, each with the folder of its cell."""
    for path in sorted(lake.rglob("*")):
        inside = path.relative_to(lake).parts
        if not _is_recording(path) or inside[0] in RESULTS:
            continue
        folder = path.parent
        while folder != lake and _is_day(folder.name):
            folder = folder.parent
        name = folder.name.partition("cell=")[2] or folder.name
        if folder == lake:
            told = FileName.parse(path.name)
            name = told.cell if told is not None else ""
        if name:
            yield _File(path, folder, unquote(name))


def _is_recording(path: Path) -> bool:
    if path.name.startswith(".") or path.name.endswith(".damaged"):
        return False
    return path.suffix in TABLES or ".mcap" in path.suffixes


def _is_day(name: str) -> bool:
    return name.startswith("day=") or _DAY.fullmatch(name) is not None


def _named(files: list[_File], lake: Path) -> list[_File]:
    """The same, with the path in place of the name where two folders have one name."""
    folders = {file.folder: file.cell for file in files if file.folder != lake}
    twice = {name for name, count in Counter(folders.values()).items() if count > 1}
    return [
        _File(file.path, file.folder, file.folder.relative_to(lake).as_posix()) if file.cell in twice else file
        for file in files
    ]


def _pattern(text: str) -> tuple[str, Path]:
    pattern, equals, file = text.rpartition("=")
    return (pattern if equals else "*"), robot_file(file).absolute()


def _robot(file: _File, lake: Path, given: Sequence[tuple[str, Path]]) -> Path:
    for pattern, path in given:
        if fnmatchcase(file.cell, pattern):
            return path
    folder = file.folder
    while True:
        if (path := folder / "robot.yaml").exists():
            return path
        if folder == lake:
            break
        folder = folder.parent
    raise ConfigError(
        f"cell {file.cell}: no description of its robot: give --robot '{file.cell}=FILE', or put a robot.yaml into "
        f"{file.folder} or a folder above it"
    )


def _one_each(described: dict[Path, RobotDescription]) -> None:
    """Raise ``ConfigError`` where two descriptions of one name differ."""
    seen: dict[str, tuple[Path, RobotDescription]] = {}
    for path, robot in described.items():
        other, same = seen.setdefault(robot.robot, (path, robot))
        if same.model_copy(update={"urdf": robot.urdf}) != robot:
            raise ConfigError(
                f"{path}: is called {robot.robot} like {other}, but differs from it: give it another name"
            )


def _day(path: Path) -> date:
    """Day on which a recording began: in its name or its folder's, else in its content. Raises ``CellwattError``."""
    if ".mcap" in path.suffixes:  # its name tells when the daemon was started, which may be weeks ago
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
