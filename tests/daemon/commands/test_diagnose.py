"""``cellwatt diagnose``: whatever is broken, a bundle is written, and no secret is in it."""

from __future__ import annotations

import errno
import json
import re
import stat
import threading
import zipfile
from pathlib import Path
from unittest.mock import Mock

import pytest
from click.testing import CliRunner, Result

from cellwatt.commands.diagnose import command
from cellwatt.errors import OutletError

SECRETS = {
    "driver": "s3cret-of-the-arm",
    "user": "s3cret-of-zenoh",
    "option": "s3cret-of-an-option",
    "environment": "s3cret-of-the-environment",
    "beside": "s3cret-that-no-setting-names",
    "quoted": 's3cret-"with"-quotes',
}
CELL = f"""\
site: plant
cell: weld
sources:
  arm: {{driver: abb, host: 192.0.2.10, robotware: 6, egm: [], password: {SECRETS["driver"]}}}
  board: {{driver: abb, host: 192.0.2.11, user: ann, password: "${{PLANT_PASSWORD}}"}}
zenoh:
  connect: [tcp/127.0.0.1:1]
  user: ann
  password: {SECRETS["user"]}
  options: {{transport/auth/usrpwd/password: {SECRETS["option"]}}}
"""
TYPO = CELL.replace("password:", "pasword:").replace("user: ann\n", f"user: ann\n  users: {SECRETS['beside']}\n")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_parts: None) -> Path:
    monkeypatch.setenv("PLANT_PASSWORD", SECRETS["environment"])
    monkeypatch.setenv("ANOTHER_SECRET", SECRETS["beside"])
    nobody = Mock(side_effect=OutletError("tcp/127.0.0.1:1: nobody answers"))
    monkeypatch.setattr("cellwatt.diagnose.contents.ask_cell", nobody)
    return tmp_path


def diagnose(folder: Path, text: str | None, *more: str) -> tuple[Result, dict[str, str]]:
    out, file = folder / "bundle.zip", folder / "weld.yaml"
    if text is not None:
        file.write_text(text)
    done = CliRunner().invoke(command, [*([str(file)] if text is not None else []), "--out", str(out), *more])
    assert done.exit_code == 0, done.output
    with zipfile.ZipFile(out) as archive:
        assert archive.testzip() is None
        return done, {name: archive.read(name).decode() for name in archive.namelist()}


def test_a_right_file_and_no_daemon(folder: Path) -> None:
    log = folder / "cellwatt.log"
    log.write_text(f"INFO started\nERROR login {SECRETS['user']} and {SECRETS['environment']} refused\n")
    done, found = diagnose(folder, CELL, "--log", str(log))
    assert found["check.txt"].startswith(f"{folder / 'weld.yaml'}: configuration is valid")
    assert json.loads(found["settings.json"])["sources"]["board"]["password"] == "${PLANT_PASSWORD}"
    assert found["log.txt"] == "INFO started\nERROR login *** and ${PLANT_PASSWORD} refused\n"
    assert "health and counts of the running daemon: tcp/127.0.0.1:1: nobody answers" in done.output
    assert done.output.split("wrote")[0] in found["README.txt"]
    assert {"cores", "clocks", "memory"} <= set(json.loads(found["pc.json"]))
    assert "pydantic" in json.loads(found["versions.json"])["packages"]
    assert stat.S_IMODE((folder / "bundle.zip").stat().st_mode) == 0o600


@pytest.mark.parametrize(
    "text",
    [
        CELL,
        TYPO,
        CELL.replace("driver: abb", "driver: abbb", 1),
        CELL.replace("zenoh:", "zenog:"),
        CELL.replace(SECRETS["user"], "[" + SECRETS["user"] + "]"),
        CELL.replace(SECRETS["user"], "'" + SECRETS["quoted"] + "'"),
        CELL + "broken: [\n",
        f"# {SECRETS['user']}\n- {SECRETS['driver']}\n",
        "",
    ],
    ids=["right", "typo", "unknown driver", "unknown section", "a list", "quotes", "no YAML", "no settings", "empty"],
)
def test_no_secret_is_in_the_bundle_whatever_is_wrong(folder: Path, text: str) -> None:
    log = folder / "cellwatt.log"
    log.write_text(
        "".join(f"{SECRETS[name]}\n" for name in ("driver", "user") if SECRETS[name] in text and text is CELL)
    )
    done, found = diagnose(folder, text, "--log", str(log))
    for secret in SECRETS.values():
        for form in (secret, json.dumps(secret)[1:-1]):
            assert not [name for name, content in found.items() if form in content]
            assert form not in done.output


def test_of_a_wrong_file_only_what_is_wrong_is_told(folder: Path) -> None:
    _, found = diagnose(folder, TYPO)
    assert "settings.json" not in found
    assert "unknown key 'pasword'; did you mean 'password'?" in found["check.txt"]


def test_without_a_file_or_with_one_that_is_not_there(folder: Path) -> None:
    _, found = diagnose(folder, None)
    assert set(found) == {"README.txt", "versions.json", "pc.json"}
    done = CliRunner().invoke(command, [str(folder / "none.yaml"), "--out", str(folder / "b.zip"), "--log", "none"])
    assert done.exit_code == 0
    assert (
        "none.yaml: cannot be read: no such file or directory"
        in zipfile.ZipFile(folder / "b.zip").read("check.txt").decode()
    )
    assert re.search(r"lines of the log: No such file or directory", done.output)


def test_the_record_that_is_not_there_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{CELL}record: {{folder: recordings}}\n"
    (folder / "bundle.zip").touch(0o644)
    _, found = diagnose(folder, text)
    assert found["recordings.json"] == "[]\n"
    assert stat.S_IMODE((folder / "bundle.zip").stat().st_mode) == 0o600
    checked = diagnose(folder, text.replace("recordings", "weld.yaml/there"))[1]["check.txt"]
    assert "weld.yaml is not a folder" in checked
    assert "configuration is valid" not in checked
    locked = Mock(side_effect=PermissionError(errno.EACCES, ""))
    monkeypatch.setattr("cellwatt.diagnose.contents.listing", locked)
    assert "recordings with sizes and verdicts: Permission denied" in diagnose(folder, text)[0].output


def test_no_secret_of_an_address_is_in_the_bundle(folder: Path) -> None:
    secret = "hunter2-night"
    (folder / "log").write_text(f"WARNING mqtt://u:{secret}@plant cannot be reached")
    text = CELL.replace("192.0.2.10", f"u:{secret}@192.0.2.10") + f"'https://h/?sig={secret}': 1\n"
    done, found = diagnose(folder, text, "--log", str(folder / "log"))
    assert "u:***@192.0.2.10" in found["check.txt"]
    assert "mqtt://***@plant" in found["log.txt"]
    for told in (done.output, *found.values()):
        assert secret not in told


def test_a_daemon_that_does_not_answer_holds_up_nobody(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    over = threading.Event()
    monkeypatch.setattr("cellwatt.diagnose.contents.ask_cell", lambda *_: over.wait(60))
    monkeypatch.setattr("cellwatt.diagnose.contents.PATIENCE", 0.1)
    done, _ = diagnose(folder, CELL)
    over.set()
    assert "health and counts of the running daemon: there was no answer within 0 s" in done.output
