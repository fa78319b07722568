"""Check that a model fits a cell: its robot, the rate of the frames, a channel of the right unit for each input."""

from __future__ import annotations

import math
from pathlib import Path, PurePath

from cellwatt.errors import ConfigError
from cellwatt.frames import Layout
from cellwatt.stage import CellInfo
from cellwatt_plugins.models.metadata import SAME_RATE, Metadata
from cellwatt_plugins.onnx_file import refused
from cellwatt_plugins.robot_name import robot_name


def check_robot(metadata: Metadata, cell: CellInfo, path: Path) -> None:
    """Raises ``ModelError`` if the model was trained for another robot, or the cell does not name its robot.

    A cell may name its robot by a path: the name in the description, or the folder's name, is then compared.
    """
    robot = cell.robot
    if metadata.robot is None:
        return
    if robot is None:
        hint = f"add 'robot: {metadata.robot}' to the settings if it is that one"
        raise refused(path, f"it is of robot {metadata.robot!r}, the cell names no robot: {hint}")
    if metadata.robot not in (PurePath(robot).name, robot, robot_name(cell)):
        raise refused(path, f"it is of robot {metadata.robot!r}, the cell's robot is {robot!r}")


def check_rate(metadata: Metadata, rate: float, path: Path) -> None:
    """Raises ``ModelError`` where the model was trained on frames of another rate, Hz."""
    if metadata.rate_hz is not None and not math.isclose(metadata.rate_hz, rate, rel_tol=SAME_RATE):
        raise refused(
            path, f"it was trained on frames at {metadata.rate_hz:g} Hz, the cell's come at {rate:g} Hz (frames: rate)"
        )


def columns(metadata: Metadata, layout: Layout, source: str | None, path: Path) -> tuple[int | None, ...]:
    """The column of the frames for each input, None for an optional one that the cell does not have.

    If ``source`` is given, its channels come first; any other source with one of those channels is then not used at
    all, so that inputs of two arms are never mixed. Raises ``ConfigError`` if the source is unknown or has no input, or
    several sources have an input, ``ModelError`` if no source has an input, or its unit differs.
    """
    usable = _usable(metadata, layout, source, path)
    found: list[int | None] = []
    for number, wanted in enumerate(metadata.inputs, start=1):
        which = f"input {number} of {len(metadata.inputs)} ({wanted.channel!r} in {wanted.unit})"
        column = _column(wanted.channel, which, layout, usable, path)
        if column is None and not wanted.optional:
            there = ", ".join(layout.names[i] for i in usable)
            raise refused(path, f"{which} is given by no source of the cell; there are: {there}")
        if column is not None and (channel := layout.channels[column]).unit != wanted.unit:
            raise refused(path, f"{which} is {channel.name} in {channel.unit} in this cell")
        found.append(column)
    return tuple(found)


def _usable(metadata: Metadata, layout: Layout, source: str | None, path: Path) -> list[int]:
    """Columns that short names may stand for."""
    if source is None:
        return list(range(len(layout.channels)))
    sources = dict.fromkeys(c.source for c in layout.channels)
    if source not in sources:
        raise ConfigError(f"no source {source!r} for the model {path}, expected one of {', '.join(sources)}")
    wanted = {i.channel for i in metadata.inputs}
    chosen = {c.short for c in layout.channels if c.source == source} & wanted
    if not chosen:
        names = ", ".join(i.channel for i in metadata.inputs)
        raise ConfigError(f"source {source!r} gives none of the inputs of the model {path}: {names}")
    rivals = {c.source for c in layout.channels if c.source != source and c.short in chosen}
    return [i for i, c in enumerate(layout.channels) if c.source not in rivals]


def _column(name: str, which: str, layout: Layout, usable: list[int], path: Path) -> int | None:
    found = [i for i in usable if layout.channels[i].short == name]
    found = found or [i for i, full in enumerate(layout.names) if full == name]
    if len(found) > 1:
        sources = ", ".join(layout.channels[i].source for i in found)
        raise ConfigError(f"{which} of the model {path} is given by several sources: set source to one of {sources}")
    return found[0] if found else None
