"""``cellwatt view``: the page by itself over Zenoh, its options, and the hash of a password."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import Mock, create_autospec

import pytest
from click.testing import CliRunner, Result

from cellwatt import ConfigError
from cellwatt.commands import view
from cellwatt.outlets.page.sessions import parse
from tests.daemon.outlets.page.cell import HASH
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE
from tests.daemon.outlets.zenoh.processes import Child
from tests.patience import PATIENCE, wait_until

WHERE = ("--connect", "tcp/127.0.0.1:7447", "--site", SITE)


def run(*arguments: object, **more: Any) -> Result:
    return CliRunner().invoke(view.command, [str(argument) for argument in arguments], **more)


@contextmanager
def viewing(*arguments: str) -> Iterator[str]:
    """The address of the page while the command runs; it ends by SIGTERM."""
    code = "from cellwatt.commands.view import command; command()"
    command = [sys.executable, "-c", code, *arguments, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            yield line.removeprefix("the page is at ").rstrip("/\n")
        finally:
            process.send_signal(signal.SIGTERM)
            code = process.wait(PATIENCE)
    assert code == 0


def get(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=PATIENCE) as response:
        return json.load(response)


def test_without_a_cell_it_is_the_plant(live: tuple[Child, str]) -> None:
    with viewing("--connect", live[1], "--site", SITE) as url:
        assert get(f"{url}/api/site")["mode"] == "plant"
        found = wait_until(lambda: [c for c in get(f"{url}/api/plant")["cells"] if c["state"]], "the cell")
        assert (found[0]["cell"], found[0]["state"]) == (CELL, "green")


def test_without_any_cell_it_is_for_recordings() -> None:
    with viewing() as url:
        told = get(f"{url}/api/site")
        assert (told["mode"], told["cells"], told["may_drop"]) == ("recordings", [], True)


def test_a_password_becomes_its_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.page.sessions.P", 1)
    ended = run("--hash-password", input="correct horse\ncorrect horse\n")
    assert ended.exit_code == 0
    assert "correct" not in ended.output
    assert parse(ended.stdout.strip().splitlines()[-1]).fits("correct horse")
    assert run("--hash-password", input="one\nother\n").exit_code == 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--foxglove",), "give a cell's FILE, or --connect, --site and --cell"),
        ((*WHERE, "--foxglove"), "--foxglove shows one cell"),
        ((*WHERE, "--arm", "arm"), "found 'arm', expected SOURCE=FILE"),
        ((*WHERE, "--page", "/nonexistent"), "does not exist"),
    ],
)
def test_what_is_missing_is_named(arguments: tuple[str, ...], text: str) -> None:
    ended = run(*arguments)
    assert ended.exit_code == 2
    assert text in ended.output


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("listen: 0.0.0.0:8480", "1:9: listen: found '0.0.0.0:8480': open to the network without TLS and users"),
        ("users: {ada: {password: plain}}", "1:25: users.ada.password: found ***: expected the hash of a password"),
        ("userss: {}", "1:1: userss: unknown key 'userss'; did you mean 'users'?"),
        ("", "1:1: the file is empty; expected listen, certificate, key"),
    ],
)
def test_mistakes_in_its_settings_are_one_line(tmp_path: Path, content: str, text: str) -> None:
    page = tmp_path / "page.yaml"
    page.write_text(content)
    error = run(*WHERE, "--page", page).exception
    assert isinstance(error, ConfigError)
    assert str(error).startswith(f"{page}:{text}")
    assert "\n" not in str(error)
    assert "plain" not in str(error)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Mock:
    """What would be shown, in place of showing it."""
    monkeypatch.setattr(view, "_run", noted := create_autospec(view._run))
    return noted


def test_paths_of_its_settings_start_at_their_file(tmp_path: Path, shown: Mock) -> None:
    page = tmp_path / "page.yaml"
    page.write_text(
        f"users: {{ada: {{password: {HASH}, may: act}}}}\ncertificate: c.pem\nkey: c.key\narms: {{arm: a.urdf}}"
    )
    assert run(*WHERE, "--page", page, "--listen", "[::1]:1").exit_code == 0
    settings = shown.call_args.args[0]
    assert (settings.certificate, settings.listen) == (tmp_path / "c.pem", "[::1]:1")
    assert settings.arms == {"arm": tmp_path / "a.urdf"}
    assert settings.may_act("ada")


def test_a_file_gives_the_cell(cell_file: Path, shown: Mock) -> None:
    assert run(cell_file, "--connect", "tcp/127.0.0.1:7", "--arm", "arm=x.urdf").exit_code == 0
    ((settings, link, site, cell, *_),) = (told.args for told in shown.call_args_list)
    assert (site, cell, link.connect) == (SITE, CELL, ("tcp/127.0.0.1:7",))
    assert settings.arms == {"arm": Path("x.urdf")}


def test_foxglove_gets_the_same_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[Any] = []
    monkeypatch.setattr("cellwatt.outlets.foxglove.serve", lambda *told, **more: served.append((told, more)))
    assert run(*WHERE, "--cell", CELL, "--foxglove", "--listen", "127.0.0.1:9", "--seconds", "2").exit_code == 0
    ((told, more),) = served
    assert told[1:] == (SITE, CELL)
    assert (more["host"], more["port"], more["seconds"]) == ("127.0.0.1", 9, 2.0)


def test_a_layout_for_the_foxglove_app_is_written(tmp_path: Path, real_parts: None) -> None:
    cell = tmp_path / "cell.yaml"
    source = "{driver: ur, host: 127.0.0.1}"
    cell.write_text(f"site: plant-1\ncell: weld_3\nsources: {{left: {source}}}\nrecord: {{folder: rec}}\n")
    out = tmp_path / "layout.json"
    assert run(cell, "--foxglove-layout", out).exit_code == 0
    assert "/frame.left_joint_1_position" in out.read_text()
    assert run("--foxglove-layout", out).exit_code == 2, "it is made from a settings file"
