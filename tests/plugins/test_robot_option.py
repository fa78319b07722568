"""Robots as they are named on the command line."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import load_robot
from cellwatt_plugins.robot.description import PACKAGED
from cellwatt_plugins.robot_option import ROBOT


@click.command()
@click.option("--robot", type=ROBOT)
def command(robot: Path) -> None:
    click.echo(load_robot(robot).robot)


def said(word: str) -> str:
    return CliRunner().invoke(command, ["--robot", word], catch_exceptions=False).output


@pytest.mark.parametrize("word", ["mh12", str(PACKAGED / "mh12"), str(PACKAGED / "mh12" / "robot.yaml")])
def test_a_name_a_folder_and_a_file(word: str) -> None:
    assert said(word) == "mh12\n"


def test_what_is_not_there() -> None:
    with pytest.raises(ConfigError, match=r"robot 'mh13': no such file or folder, .*did you mean mh12"):
        said("mh13")
    assert "arm/robot.yaml' does not exist" in said("arm/robot.yaml")


def test_a_folder_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mh12").mkdir()
    monkeypatch.chdir(tmp_path)
    assert "mh12/robot.yaml' does not exist" in said("mh12")
