"""Name of the robot in a cell, for stages that need no arm."""

from __future__ import annotations

import re

from pydantic import BaseModel

from cellwatt.config import read_settings
from cellwatt.files import read_bytes
from cellwatt.stage import CellInfo


class _Named(BaseModel):
    robot: str


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
