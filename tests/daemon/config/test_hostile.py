"""Settings that were made to hang, fill or flood whoever reads them get one line, or the first mistakes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.config.places import MOST
from cellwatt.errors import ConfigError

HEAD = "site: a\ncell: b\nsources:\n  arm: {driver: arm, host: h}\n"


def lists(depth: int) -> str:
    return "[" * depth + "]" * depth


def chain(length: int) -> str:
    """Settings that take over settings that take over …"""
    return "a0: &a0 {}\n" + "".join(f"a{i}: &a{i} {{<<: *a{i - 1}}}\n" for i in range(1, length))


def ladder(length: int) -> str:
    """Each in the next, so that aliases nest though nothing written does."""
    return "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, length))


ATTACKS = {
    "lists 400 deep": f"{HEAD}note: {lists(400)}\n",
    "180,000 merges": f"a: &a {{}}\nb: {{<<: [{'*a,' * 180_000}]}}\n{HEAD}",
    "merges of merges": f"{chain(2000)}{HEAD}",
    "aliases of aliases": f"{ladder(2000)}{HEAD}",
    "60,000 unknown keys": HEAD + "".join(f"k{i}: 1\n" for i in range(60_000)),
    "9,000 sources": "site: a\ncell: b\nsources:\n" + "".join(f"  s{i}: {{}}\n" for i in range(9_000)),
    "a value of 900,000 characters": HEAD.replace("host: h", f"host: h, rate: {'x' * 900_000}"),
    "a key of 900,000 characters": f'{HEAD}? "{"k" * 900_000}"\n: 1\n',
}


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> float:
    """s for as many values as are allowed at all."""
    file = tmp_path_factory.mktemp("honest") / "cell.yaml"
    file.write_text(HEAD + "note: [" + "1," * 15_000 + "]\n")
    return refused(file)[1]


@pytest.mark.parametrize("text", ATTACKS.values(), ids=ATTACKS)
def test_one_line_at_the_cost_of_a_large_honest_file(cell_file: Path, text: str, usual: float) -> None:
    cell_file.write_text(text)
    said, needed = refused(cell_file)
    assert len(said.splitlines()) == 1
    assert len(said) < 2500
    # A machine may be slow, but not a hundred times slower for an attack.
    assert needed < 6 * usual


def refused(file: Path) -> tuple[str, float]:
    """What is said of a file, and the processor time that it took, s."""
    began = time.process_time()
    with pytest.raises(ConfigError) as caught:
        load(file, {})
    return str(caught.value), time.process_time() - began


def test_of_many_mistakes_the_first_are_told_and_that_there_are_more(cell_file: Path) -> None:
    keys = [f"k{i}" for i in range(1000)]
    cell_file.write_text(HEAD.replace("}", ", " + ", ".join(f"{key}: 1" for key in keys) + "}"))
    said, _ = refused(cell_file)
    *told, closing = said.splitlines()
    assert [line.split("unknown key ")[1].split("'")[1] for line in told] == keys[:MOST]
    assert closing == f"{cell_file}: and more"


NO_FILES = {
    "a FIFO, expected a file": os.mkfifo,
    "a device, expected a file": lambda path: path.symlink_to("/dev/zero"),
    "is a directory": Path.mkdir,
    "larger than 1,000,000 bytes": lambda path: path.touch() or os.truncate(path, 10_000_000_000),
}


@pytest.mark.timeout(60)  # a FIFO that is opened holds its reader up for ever
@pytest.mark.parametrize("reason", NO_FILES)
def test_settings_that_are_no_file(tmp_path: Path, reason: str) -> None:
    path = tmp_path / "cell.yaml"
    NO_FILES[reason](path)
    assert refused(path)[0] == f"{path}: cannot be read: {reason}"
