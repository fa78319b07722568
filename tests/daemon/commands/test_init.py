"""``cellwatt init`` writes what its options say."""

from __future__ import annotations

import errno
from unittest.mock import Mock

import pytest
from click.testing import CliRunner

from cellwatt.commands import init
from cellwatt.config import load
from cellwatt.errors import CellwattError, ConfigError

pytestmark = pytest.mark.usefixtures("real_parts")

ALL = ("--site", "plant-1", "--cell", "weld_3", "--no-doctor")


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    return lambda *arguments: CliRunner().invoke(init.command, arguments)


def test_by_options(run, tmp_path):
    ended = run(
        *ALL, "--source", "arm=ur:192.0.2.10", "--source", "supply=scpi_analyzer:192.0.2.11", "--set", "arm.rate=125 Hz"
    )
    assert ended.exit_code == 0, ended.output
    config = load(tmp_path / "cell.yaml")
    assert (config.site, config.cell) == ("plant-1", "weld_3")
    assert config.sources["arm"].settings.rate == 125 and config.sources["supply"].settings.host == "192.0.2.11"
    assert config.record is not None and config.record.folder == tmp_path / "recordings"
    assert not (tmp_path / "recordings").exists()
    for line in ("configuration is valid", "cellwatt doctor cell.yaml", "cellwatt run cell.yaml", "docs/install.md"):
        assert line in ended.output


def test_the_next_commands_name_a_file_with_a_space_as_a_shell_reads_it(run):
    ended = run("my cell.yaml", *ALL, "--source", "arm=ur:192.0.2.10")
    assert "cellwatt run 'my cell.yaml'" in ended.output


def test_what_is_missing_is_one_line(run, tmp_path):
    ended = run()
    assert ended.exit_code == 2 and "name each device: --source NAME=DRIVER:ADDRESS" in ended.output
    with pytest.raises(ConfigError, match=r"is not written: sources\.arm: the key 'host' is missing"):
        raise run("--source", "arm=ur").exception
    assert not list(tmp_path.iterdir())


def test_a_file_is_replaced_only_by_force_and_as_a_whole(run, tmp_path, monkeypatch):
    file = tmp_path / "cell.yaml"
    file.write_text("mine")
    again = (*ALL, "--source", "arm=ur:192.0.2.10")
    ended = run(*again)
    assert ended.exit_code == 2 and "--force" in ended.output and file.read_text() == "mine"
    with monkeypatch.context() as full:
        full.setattr("os.fsync", Mock(side_effect=OSError(errno.ENOSPC, "")))
        assert isinstance(run(*again, "--force").exception, CellwattError) and file.read_text() == "mine"
    assert run(*again, "--force").exit_code == 0
    assert load(file).cell == "weld_3"


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (("--set", "arm.rate"), "expected NAME.KEY=VALUE"),
        (("--set", "amr.rate=1 Hz"), "no source 'amr'; did you mean 'arm'?"),
        (("--source", "arm=ur:192.0.2.12"), "two sources have the same name"),
    ],
)
def test_options_that_do_not_fit(run, tmp_path, wrong, told):
    ended = run(*ALL, "--source", "arm=ur:192.0.2.10", *wrong)
    assert ended.exit_code == 2 and told in ended.output
    assert not list(tmp_path.iterdir())
