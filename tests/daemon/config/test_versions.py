"""Older settings files are brought up to date, with comments and order, and newer ones refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from cellwatt.config import load
from cellwatt.config.document import read
from cellwatt.config.versions import MIGRATIONS, NEWEST, migrated
from cellwatt.errors import ConfigError
from cellwatt.outlets.zenoh import ZenohOutlet

HEAD = "site: a # the plant\ncell: b\nsources:\n  arm: {driver: arm, host: h}\n"
OPEN = "tcp/0.0.0.0:7447"


@pytest.fixture(autouse=True)
def _real_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.config.versions.outlet", lambda name: ZenohOutlet)


def to_newest(tmp_path: Path, text: str, version: int = 0) -> str:
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    return migrated(read(file, {}), version)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (f"zenoh: {{listen: [{OPEN}]}} # all\n", f"zenoh: {{open: true, listen: [{OPEN}]}} # all\n"),
        (f"zenoh:\n  # all\n  listen: [{OPEN}]\n", f"zenoh:\n  # all\n  open: true\n  listen: [{OPEN}]\n"),
        (f"zenoh: {{\n    listen: [{OPEN}]}}\n", f"zenoh: {{\n    open: true, listen: [{OPEN}]}}\n"),
        (f"zenoh: &bus\n  listen: [{OPEN}]\n", f"zenoh: &bus\n  open: true\n  listen: [{OPEN}]\n"),
        ("zenoh: {scouting: true}\n", "zenoh: {open: true, scouting: true}\n"),
        ("zenoh: {listen: [tcp/127.0.0.1:7447]}\n", None),
        (f"zenoh: {{listen: [{OPEN}], open: false}}\n", None),
        ("zenoh: {listen: [nonsense]}\n", None),
        ("zenoh: off\n", None),
        ("zenoh:\n", None),
        ("", None),
    ],
)
def test_a_cell_open_to_the_network_says_so_since_version_1(tmp_path: Path, before: str, after: str | None) -> None:
    assert to_newest(tmp_path, HEAD + before) == f"version: 1\n{HEAD}{before if after is None else after}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("version: 0\nsite: a\n", "version: 1\nsite: a\n"),
        ("site: a\nversion: 0 # old\n", "site: a\nversion: 1 # old\n"),
        ("# the cell\n\nsite: a\n", "# the cell\n\nversion: 1\nsite: a\n"),
        ("{site: a}\n", "{version: 1, site: a}\n"),
        ("---\nsite: ä\n", "---\nversion: 1\nsite: ä\n"),
    ],
)
def test_the_version_is_stated_in_the_style_of_the_file(tmp_path: Path, text: str, expected: str) -> None:
    assert to_newest(tmp_path, text) == expected


def test_the_newest_form_stays_byte_for_byte(tmp_path: Path) -> None:
    text = to_newest(tmp_path, f"{HEAD}zenoh: {{listen: [{OPEN}]}}\n")
    assert to_newest(tmp_path, text, NEWEST) == text


def test_each_migration_leads_to_the_next_version() -> None:
    assert len(MIGRATIONS) == NEWEST == 1


def test_a_file_without_version_is_read_as_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(HEAD)
    config = load(file)
    assert (config.text, config.warnings) == (HEAD, ())


def test_an_older_file_is_migrated_in_memory_and_told(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(f"version: 0\n{HEAD}")
    config = load(file)
    assert yaml.safe_load(config.text)["version"] == NEWEST
    assert config.warnings == (
        f"settings of version 0 are read as version 1: cellwatt migrate {file} shows the changes",
    )
    assert file.read_text().startswith("version: 0")


def test_a_newer_file_is_refused_with_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(f"version: 7\nshape: new\n{HEAD}")
    with pytest.raises(ConfigError) as refused:
        load(file)
    (problem,) = refused.value.problems
    assert problem.place == f"{file}:1:10"
    assert "settings of version 7, this cellwatt reads up to version 1" in problem.message


@pytest.mark.parametrize("value", ["one", "-1", "1.5", "[1]"])
def test_a_version_that_is_none_is_a_mistake_at_its_place(tmp_path: Path, value: str) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(f"{HEAD}version: {value}\n")
    with pytest.raises(ConfigError, match=r"cell.yaml:5:\d+: version"):
        load(file)
