"""Name and files of the robot in a cell, for stages that need no arm."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel

from cellwatt.config import read_settings
from cellwatt.errors import ConfigError
from cellwatt.files import read_bytes
from cellwatt.stage import CellInfo, StageSettings


class _Named(BaseModel):
    robot: str
    urdf: Path | None = None


class RobotStageSettings(StageSettings):
    """Settings of a stage that reads the description of the cell's robot, or of its own setting ``robot``."""

    def files(self, folder: Path, robot: Path | None) -> Sequence[Path]:
        """See ``StageSettings.files``; with the URDF that the description names."""
        own: Path | None = getattr(self, "robot", None)
        used = robot if own is None else folder / own
        return [*super().files(folder, robot), *([] if used is None else _described(used))]


def _described(robot: Path) -> list[Path]:
    """A description, or that in a folder, and its URDF; a mistake in it is reported when the stage is created."""
    file = robot / "robot.yaml" if robot.is_dir() else robot
    try:
        urdf = read_settings(file, _Named).urdf
    except ConfigError:
        return [file]
    return [file] if urdf is None else [file, file.parent / urdf]


def robot_name(cell: CellInfo) -> str | None:
    """The cell's ``robot``, or, if that is the path of a description, the name in it. Raises ``ConfigError``.

    An MJCF has its file's name, as in ``robot.simulated``; so has a URDF without a name.
    """
    path = cell.folder / (cell.robot or "nowhere")
    file = path / "robot.yaml" if path.is_dir() else path
    if file.suffix.lower() in (".xml", ".mjcf", ".urdf") and file.is_file():
        named = re.search(rb"<robot\b[^>]*\bname\s*=\s*[\"']([^\"']+)", read_bytes(file))
        return named[1].decode("utf-8", "replace") if named else file.stem
    described = cell.robot and file.suffix in (".yaml", ".yml") and file.is_file()
    return read_settings(file, _Named).robot if described else cell.robot
