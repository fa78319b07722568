from __future__ import annotations

import json

from click.testing import CliRunner

from cellwatt.commands.check import command
from tests.daemon.config.conftest import VALID


def run(*arguments):
    return CliRunner().invoke(command, [str(a) for a in arguments], catch_exceptions=False)


def test_a_right_file(cell_file):
    result = run(cell_file)
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines[0] == (
        f"{cell_file}: configuration is valid. Cell weld-3 at plant-1: "
        "2 sources, 5 channels in frames at 50 Hz with a latency of 100 ms"
    )  # fmt: skip
    assert [line.split() for line in lines[1:4]] == [
        ["source", "driver", "stream", "rate", "clock", "channels"],
        ["arm", "arm", "state", "500", "Hz", "device", "joint_1…3.position,", "supply.power"],
        ["board", "meter", "power", "on", "change", "host", "bus.power"],
    ]
    assert lines[5].split() == ["stage", "kind", "needs"]
    assert sorted(line.split() for line in lines[6:9]) == [["cut", "cut"], ["power", "net"], ["watch", "watch", "cut"]]
    assert lines[-1] == f"record: {cell_file.parent / 'recordings'}; outlets: zenoh"
    assert not any(line != line.rstrip() for line in lines)


def test_mistakes_one_a_line_in_order_and_exit_code_2(cell_file):
    cell_file.write_text(VALID.replace("rate: 500 Hz", "rate: 500").replace("site", "sight"))
    result = run(cell_file)
    assert result.exit_code == 2
    first, second = result.output.splitlines()
    assert first.startswith(f"{cell_file}:1:1: sight: unknown key")
    assert second.startswith(f"{cell_file}:5:46: sources.arm.rate: found 500: expected")


def test_json(cell_file):
    result = run(cell_file, "--json")
    assert (result.exit_code, json.loads(result.stdout)) == (0, [])
    cell_file.write_text(VALID.replace("500 Hz", "fast"))
    result = run(cell_file, "--json", cell_file.with_name("absent.yaml"))
    assert result.exit_code == 2
    absent, rate = json.loads(result.stdout)
    assert (absent["line"], absent["column"]) == (None, None)
    assert absent["file"].endswith("absent.yaml")
    assert rate == {
        "file": str(cell_file),
        "line": 5,
        "column": 46,
        "path": "sources.arm.rate",
        "message": "found 'fast': expected a number with its unit, like '500 Hz' (units: Hz, kHz)",
    }


def test_a_record_folder_that_cannot_be_made_is_a_mistake(cell_file):
    (cell_file.parent / "file").touch()
    folder = cell_file.parent / "file" / "recordings"
    cell_file.write_text(VALID.replace("folder: recordings", "folder: file/recordings"))
    result = run(cell_file)
    assert result.exit_code == 2
    line = next(n for n, text in enumerate(VALID.splitlines(), 1) if "folder: recordings" in text)
    assert f"{cell_file}:{line}:" in result.output
    refusal = f"folder {folder} cannot be created: {cell_file.parent / 'file'} is not a folder"
    assert f"record.folder: {refusal}" in result.output
    (told,) = json.loads(run(cell_file, "--json").stdout)
    assert (told["line"], told["path"]) == (line, "record.folder")


def test_a_record_section_without_a_folder_has_that_of_the_user(cell_file, tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    assert "folder: recordings, " in VALID
    cell_file.write_text(VALID.replace("folder: recordings, ", ""))
    result = run(cell_file)
    assert result.exit_code == 0, result.output
    assert f"record: {tmp_path / 'state'}; outlets" in result.output
    assert not (tmp_path / "state").exists()


def test_schema():
    result = run("--schema")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["title"] == "cellwatt cell"
