"""Settings files state their form; newer ones are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.errors import ConfigError

HEAD = "site: a # the plant\ncell: b\nsources:\n  arm: {driver: arm, host: h}\n"


def test_a_file_without_version_is_read_as_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(HEAD)
    config = load(file)
    assert (config.text, config.warnings) == (HEAD, ())


def test_a_newer_file_is_refused_with_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(f"version: 7\nshape: new\n{HEAD}")
    with pytest.raises(ConfigError) as refused:
        load(file)
    (problem,) = refused.value.problems
    assert problem.place == f"{file}:1:10"
    assert "settings of version 7, this cellwatt reads version 1" in problem.message


def test_a_version_that_is_none_is_a_mistake_at_its_place(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    for value in ("one", "0", "1.5", "[1]"):
        file.write_text(f"{HEAD}version: {value}\n")
        with pytest.raises(ConfigError, match=r"cell.yaml:5:\d+: version"):
            load(file)
