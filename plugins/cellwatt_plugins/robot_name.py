"""Name of the robot in a cell, for stages that need no arm."""

from __future__ import annotations

from pydantic import BaseModel

from cellwatt.config import read_settings
from cellwatt.stage import CellInfo


class _Named(BaseModel):
    robot: str


def robot_name(cell: CellInfo) -> str | None:
    """The cell's ``robot``, or, if that is the path of a description, the name in it. Raises ``ConfigError``."""
    path = cell.folder / (cell.robot or "nowhere")
    file = path / "robot.yaml" if path.is_dir() else path
    described = cell.robot and file.suffix in (".yaml", ".yml") and file.is_file()
    return read_settings(file, _Named).robot if described else cell.robot
