"""``cellwatt init``: by options, by questions, and against a device."""

from __future__ import annotations

import asyncio
from importlib.metadata import entry_points

import pytest
from click.testing import CliRunner

from cellwatt import registry
from cellwatt.commands import init
from cellwatt.config import load
from cellwatt.emulation.process import EmulatorProcess
from cellwatt.errors import ConfigError

ALL = ("--site", "plant-1", "--cell", "weld_3", "--no-doctor")


@pytest.fixture(autouse=True)
def _real_parts(monkeypatch: pytest.MonkeyPatch, _fake_parts: None) -> None:
    monkeypatch.setattr(registry, "entry_points", entry_points)
    registry.available.cache_clear()


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str, answers: str | None = None):
        monkeypatch.setattr(init, "at_terminal", lambda: answers is not None)
        return CliRunner().invoke(init.command, arguments, input=answers)

    return call


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


def test_what_is_missing_is_one_line(run, tmp_path):
    ended = run("--cell", "weld_3", "--source", "arm=ur")
    assert str(ended.exception) == (
        "cellwatt init: missing: --site, the address in --source arm=ur:ADDRESS (no terminal to ask at)"
    )
    assert isinstance(ended.exception, ConfigError)
    assert str(run("--yes").exception) == "cellwatt init: missing: --source"
    assert not list(tmp_path.iterdir())


def test_nothing_is_asked_at_a_terminal_where_the_options_suffice(run, tmp_path):
    ended = run(*ALL, "--source", "arm=ur:192.0.2.10", "--source", "supply=scpi_analyzer:192.0.2.11", answers="mine")
    assert ended.exit_code == 0, ended.output
    assert load(tmp_path / "cell.yaml").record is not None


def test_a_file_is_replaced_only_by_force(run, tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text("mine")
    again = (*ALL, "--source", "arm=ur:192.0.2.10")
    ended = run(*again)
    assert ended.exit_code == 2 and "--force" in ended.output and file.read_text() == "mine"
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


def test_by_questions(run, tmp_path):
    answers = [
        "",
        "weld_3",
        "nonsense",
        "ur",
        "192.0.2.10",
        "",
        "modbus_meter",
        "192.0.2.12:1502",
        "eastron_sdm630",
        "mains",
        "",
    ]
    ended = run("--no-doctor", answers="\n".join([*answers, "none", ""]))
    assert ended.exit_code == 0, ended.output
    assert "no driver named 'nonsense'" in ended.output
    config = load(tmp_path / "cell.yaml")
    assert (config.site, config.cell, config.record) == ("plant-1", "weld_3", None)
    meter = config.sources["mains"].settings
    assert (meter.host, meter.port, meter.meter) == ("192.0.2.12", 1502, "eastron_sdm630")
    assert list(config.sources) == ["arm", "mains"]


@pytest.mark.system
@pytest.mark.slow
async def test_devices_are_asked_who_they_are(run):
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm:
        answers = ["", "", "ur", arm.address, "", "", "", "y", ""]
        ended = await asyncio.to_thread(run, answers="\n".join(answers))
    assert ended.exit_code == 0, ended.output
    assert "asking it, read-only … Universal Robots" in ended.output and "rtde 5" in ended.output
    assert "verdict" in ended.output
