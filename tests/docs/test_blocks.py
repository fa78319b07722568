"""Every code block of the documentation is run, or says who runs it or why nobody does."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
import yaml

from cellwatt.commands import cli
from cellwatt.commands.emulate import command as emulate
from cellwatt.config import load
from cellwatt.emulation import ArmSignals
from cellwatt.emulation.cell import emulator_of
from cellwatt.registry import available
from tests.docs.pages import EVERY_BLOCK, PAGES, ROOT, Block, blocks
from tests.drivers.running import served
from tests.patience import PATIENCE

SHOWN = ("text", "c", "xml")
"""Languages of what is only looked at: output, wire formats, files of other programs."""
OURS = [block for block in EVERY_BLOCK if block.language == "sh"]
CELL_KEYS = {"site", "cell", "robot", "sources", "frames", "stages", "record", "units"} | set(
    available("cellwatt.outlets")
)
NEEDED = {"site": "plant-1", "cell": "weld-3", "sources": {"arm": {"driver": "ur", "host": "192.0.2.10"}}}


def by_page(blocks: list[Block]) -> pytest.MarkDecorator:
    """Tests, one a page, of some of its blocks."""
    pages: dict[str, list[Block]] = {}
    for block in blocks:
        pages.setdefault(block.page, []).append(block)
    return pytest.mark.parametrize("blocks", pages.values(), ids=pages)


def of(*languages: str) -> list[Block]:
    """The blocks of some languages that are run here."""
    return [block for block in EVERY_BLOCK if block.language in languages and block.run_here]


def test_blocks_are_fenced_and_name_their_language() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fences = re.findall(r"^```(.*)$", text, re.MULTILINE)
        assert len(fences) == 2 * len(blocks(page)), f"{page}: a fence is not closed, or indented"
        found = {block.language for block in blocks(page)}
        assert found <= {"sh", "python", "yaml", "toml", "ini", "json", *SHOWN}, page
        outside = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
        indented = re.search(r"^[^-*\d\s].*\n\n    \S", outside, re.MULTILINE)
        assert not indented, f"{page}: an indented block names no language"


def test_a_note_says_who_runs_the_block_or_why_nobody_does() -> None:
    for block in EVERY_BLOCK:
        if block.note.startswith("not run"):
            assert re.match(r"not run: \w.{8,}", block.note), block
        elif block.note:
            paths = block.note.removeprefix("run by ").split(", ")
            assert block.note.startswith("run by ") and all((ROOT / path).is_file() for path in paths), block


def words(line: str) -> list[str]:
    """Words of a command of ours as the shell splits them; redirections and what follows a pipe are left out."""
    out = shlex.split(line.replace("…", ""), comments=True)
    for end in ("|", ">", "&&", "&", ";", "2>"):
        out = out[: out.index(end)] if end in out else out
    return out


@by_page([block for block in OURS if re.search(r"^cellwatt ", block.text, re.MULTILINE)])
def test_commands_and_options_are_there(blocks: list[Block]) -> None:
    lines = [(block, line) for block in blocks for line in block.commands() if line.startswith("cellwatt ")]
    for block, line in lines:
        context = cli.make_context("cellwatt", words(line)[1:])
        try:
            while isinstance(context.command, click.Group):
                rest = [*context._protected_args, *context.args]
                if not rest and context.command.invoke_without_command:
                    break
                name, command, rest = context.command.resolve_command(context, rest)
                assert command is not None, line
                context = command.make_context(name, rest, parent=context)
        except click.BadParameter as error:
            if "does not exist" not in error.message:  # files of the reader's
                raise AssertionError(f"{block}: {line}: {error.format_message()}") from error
        except click.exceptions.Exit:  # --version, --help
            pass
        except click.UsageError as error:
            raise AssertionError(f"{block}: {line}: {error.format_message()}") from error


EMULATORS = [
    pytest.param(words(line), id=f"{block}: {' '.join(words(line)[2:])}")
    for block in OURS
    for line in block.commands()
    if line.startswith("cellwatt emulate ") and block.run_here
]


@pytest.mark.parametrize("command", EMULATORS)
async def test_emulated_devices_of_the_pages_serve(command: list[str], tmp_path: Path) -> None:
    _, name, *arguments = [word.replace("/tmp/", f"{tmp_path}/") for word in command]
    if "--listen" not in arguments and arguments[0] not in ("can_sensor", "power_board"):  # terminals of their own
        arguments += ["--listen", "127.0.0.1:0"]  # the standard port may be in use
    given = emulate.make_context(name, arguments).params
    options = dict(option.split("=") for option in given["options"])
    async with served(emulator_of(given["driver"])(ArmSignals(), given["address"], options=options)) as address:
        assert address


def others() -> list[Block]:
    """Shell blocks to be run in full: none of an emulated device, which never ends."""
    return [b for b in of("sh") if not b.text.startswith("cellwatt emulate ")]


@by_page(others())
def test_commands_of_the_page_run(blocks: list[Block], tmp_path: Path) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in blocks:
        done = subprocess.run(
            ["bash", "-e", "-c", block.text],
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
            check=False,
            timeout=120 * PATIENCE,
        )
        assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"


@by_page(of("python"))
def test_programs_of_the_page_run(blocks: list[Block], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile("\n" * block.line + block.text, block.page, "exec"), names)


@by_page(of("yaml"))
def test_settings_are_right(blocks: list[Block], tmp_path: Path) -> None:
    for block in blocks:
        keys = set(yaml.safe_load(block.text) or {})
        assert keys <= CELL_KEYS, f"{block}: no settings of a cell: say in a note who reads it"
        rest = {key: value for key, value in NEEDED.items() if key not in keys}
        cell = tmp_path / f"line-{block.line}.yaml"
        cell.write_text(f"{block.text}\n{yaml.safe_dump(rest) if rest else ''}")
        robots = [f"{folder}/robot.yaml" for folder in re.findall(r"^robot: (\w+/[\w./-]+)", block.text, re.MULTILINE)]
        for model in (*re.findall(r"[\w./-]+\.onnx", block.text), *robots):  # the reader's
            (tmp_path / model).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / model).touch()
        load(cell, dict.fromkeys(re.findall(r"\$\{(\w+)}", block.text), "given"))


READ = {"json": json.loads, "toml": tomllib.loads, "ini": configparser.ConfigParser(strict=False).read_string}


@by_page(of(*READ))
def test_files_can_be_read(blocks: list[Block]) -> None:
    for block in blocks:
        READ[block.language](block.text.replace("…", ""))
