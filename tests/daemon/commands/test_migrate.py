"""``cellwatt migrate``: a diff, a file, no secret on the screen."""

from __future__ import annotations

import stat
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from cellwatt import registry
from cellwatt.commands import main
from cellwatt.commands.migrate import command

CELL = """\
site: plant # north hall
cell: weld
sources:
  arm: {driver: kinova, host: 192.0.2.10, password: geheim99}
zenoh: {listen: [tcp/0.0.0.0:7447], user: ann, password: abc}
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(registry, "entry_points", entry_points)
    registry.available.cache_clear()
    path = tmp_path / "weld.yaml"
    path.write_text(CELL)
    path.chmod(0o640)
    return path


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["cellwatt", "migrate", *map(str, arguments)])
    monkeypatch.setattr("cellwatt.commands.Commands.get_command", lambda self, context, name: command)
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_the_diff_shows_the_change_and_no_secret(monkeypatch, capsys, file: Path) -> None:
    assert run(monkeypatch, file) == 0
    out = capsys.readouterr().out
    assert "+version: 1\n" in out
    assert '-zenoh: {listen: [tcp/0.0.0.0:7447], user: ann, password: "***"}' in out
    assert '+zenoh: {open: true, listen: [tcp/0.0.0.0:7447], user: ann, password: "***"}' in out
    assert "geheim99" not in out
    assert "abc" not in out
    assert file.read_text() == CELL


def test_the_file_is_changed_only_when_asked_and_the_old_one_kept(monkeypatch, capsys, file: Path) -> None:
    assert run(monkeypatch, file, "--write") == 0
    assert file.read_text() == f"version: 1\n{CELL}".replace("{listen", "{open: true, listen")
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert file.with_name("weld.yaml.old").read_text() == CELL
    assert sorted(p.name for p in file.parent.iterdir()) == ["weld.yaml", "weld.yaml.old"]
    capsys.readouterr()
    assert run(monkeypatch, file, "--write") == 0
    assert capsys.readouterr().out == f"{file}: version 1 is the newest, nothing to change\n"


def test_what_is_wrong_beside_is_told(monkeypatch, capsys, file: Path) -> None:
    file.write_text(CELL.replace("host:", "hots:"))
    assert run(monkeypatch, file) == 2
    ended = capsys.readouterr()
    assert "+version: 1" in ended.out
    assert "unknown key 'hots'; did you mean 'host'?" in ended.err
