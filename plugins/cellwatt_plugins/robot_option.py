"""The option ``--robot`` of commands, and its type, which loads the arm's libraries when it is used."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import click

from cellwatt.commands.options import Input
from cellwatt.fetch import is_url


class _Robot(Input):
    def convert(self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from cellwatt_plugins.robot.description import robot_file

        is_place = isinstance(value, str) and not is_url(value)
        return super().convert(robot_file(value) if is_place else value, param, ctx)


ROBOT: Final = _Robot(exists=True, path_type=Path)
"""The path or URL of a description or of its folder, or the name of a packaged robot; all are converted to a path."""
with_robot: Final = click.option(
    "--robot", required=True, type=ROBOT, help="The robot's description, its folder, or a packaged robot."
)
