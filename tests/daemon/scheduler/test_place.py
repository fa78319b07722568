"""Names of schedulers, and what is said of those that are none."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cellwatt import ConfigError
from cellwatt.commands.scheduling import with_scheduler
from cellwatt.scheduler import scheduled, spread
from cellwatt.scheduler.spread import parse_place


@pytest.mark.parametrize(("text", "workers"), [("local", None), ("local:3", 3)])
def test_names_of_schedulers(text: str, workers: int | None) -> None:
    assert parse_place(text) == workers


@pytest.mark.parametrize(
    "text",
    [
        "",
        "locale",
        "local:0",
        "local:-1",
        "tcp://host:8786",
    ],
)
def test_what_names_no_scheduler_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="names no scheduler: expected local, or local:2"):
        parse_place(text)
    with pytest.raises(ConfigError, match="names no scheduler"), scheduled(text):
        raise AssertionError


def test_the_option_refuses_it_before_the_command_begins() -> None:
    @click.command()
    @with_scheduler
    def command() -> None:
        raise AssertionError

    done = CliRunner().invoke(command, ["--scheduler", "http://host"])
    assert done.exit_code == 2
    assert "'http://host' names no scheduler: expected local" in done.output


def test_without_one_the_work_is_serial() -> None:
    with scheduled(None):
        assert spread(abs, [-1, -2], "numbers") == [1, 2]
        assert spread(pow, [2, 3], "numbers", shared=2) == [4, 9]


def test_relative_paths_stay_relative_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert spread(str, [Path("a"), Path("b")], "paths") == ["a", "b"]
