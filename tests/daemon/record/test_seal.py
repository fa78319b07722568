"""Signed recordings: what is told of files that were changed, exchanged or taken away."""

from __future__ import annotations

import asyncio
import hashlib
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from cellwatt.commands.secure import command as secure
from cellwatt.record import Recording, RecordSettings
from cellwatt.record.seal import verify
from tests.patience import PATIENCE

from .making import batch_of, started, write_chunks


async def record(settings: RecordSettings, blocks: int) -> None:
    async with started(settings) as recorder:
        for n in range(blocks):
            assert recorder.put(batch_of(n * 10, 10))
            if n % 10 == 0:
                assert await asyncio.to_thread(recorder.flush, PATIENCE)


@pytest.fixture
def folder(keys: Path) -> Path:
    """Some finished files of one session, signed."""
    settings = RecordSettings(folder=keys / "recordings", file_size=30e3, flush=3600.0, sign=keys / "cell.key")
    asyncio.run(record(settings, 200))
    assert len(list(settings.folder.glob("*.mcap"))) >= 3
    return settings.folder


def told(folder: Path, key: Path) -> dict[str, str]:
    """What is wrong, by file."""
    return {file.name: problem for file, _, problem in verify([folder], key) if problem}


def test_every_finished_file_is_signed(folder: Path, keys: Path) -> None:
    found = list(verify([folder], keys / "cell.pub"))
    assert [file for file, _, _ in found] == sorted(folder.glob("*.mcap"))
    assert {(state, problem) for _, state, problem in found} == {("closed", "")}
    assert len(Recording.open(folder).paths) == len(found)  # seals are no recordings


def test_openssl_verifies_a_seal(folder: Path, keys: Path) -> None:
    file = min(folder.glob("*.mcap"))
    seal = json.loads(file.with_name(file.name + ".sig").read_text())
    data = file.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    parts = ("cellwatt: recording of a cell, version 1", file.name, str(len(data)), digest, "closed")
    (keys / "signed").write_bytes(b"".join(len(p).to_bytes(8, "little") + p.encode() for p in parts))
    (keys / "signature").write_bytes(bytes.fromhex(seal["signature"]))
    command = "openssl pkeyutl -verify -rawin -pubin -inkey cell.pub -in signed -sigfile signature"
    subprocess.run(command.split(), cwd=keys, check=True, capture_output=True)


def flip(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def exchange(file: Path) -> None:
    """Another file of the same cell under this name, with its seal."""
    other = max(file.parent.glob("*.mcap"))
    for end in ("", ".sig"):
        file.with_name(file.name + end).write_bytes(other.with_name(other.name + end).read_bytes())


def unsign(file: Path) -> None:
    file.with_name(file.name + ".sig").unlink()


def fit(file: Path) -> None:
    """The digest in the seal is made that of a changed file; only the signature is not."""
    flip(file)
    seal = file.with_name(file.name + ".sig")
    plain = json.loads(seal.read_text()) | {"sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    seal.write_text(json.dumps(plain))


def spoil(file: Path) -> None:
    file.with_name(file.name + ".sig").write_bytes(b'{"signature": "zz"' + bytes(range(256)))


@pytest.mark.parametrize(
    ("attack", "problem"),
    [
        (flip, "was changed after its cell signed it"),
        (exchange, "was signed under another name: "),
        (unsign, "is not signed"),
        (spoil, "is not signed"),
        (fit, "is signed with another key, or its signature was changed"),
    ],
)
def test_what_was_done_to_a_file_is_told(
    folder: Path, keys: Path, attack: Callable[[Path], None], problem: str
) -> None:
    file = min(folder.glob("*.mcap"))
    attack(file)
    (only,) = told(folder, keys / "cell.pub").items()
    assert only[0] == file.name
    assert only[1].startswith(problem)


def test_a_file_that_was_taken_away_is_told(folder: Path, keys: Path) -> None:
    first, middle, *_ = sorted(folder.glob("*.mcap"))
    middle.unlink()
    assert list(told(folder, keys / "cell.pub")) == [middle.name]
    first.unlink()  # the oldest go when room is made: that is nothing
    assert told(folder, keys / "cell.pub") == {}


def test_the_command_refuses(folder: Path, keys: Path) -> None:
    arguments = ["verify", str(keys / "cell.pub"), str(folder)]
    good = CliRunner().invoke(secure, arguments, catch_exceptions=False)
    assert (good.exit_code, good.output.count("since its cell signed it")) == (0, len(list(folder.glob("*.mcap"))))
    flip(min(folder.glob("*.mcap")))
    bad = CliRunner().invoke(secure, arguments, catch_exceptions=False)
    assert bad.exit_code == 1
    assert "was changed after" in bad.output


async def test_a_repaired_file_is_told_as_such(keys: Path) -> None:
    folder = keys / "recordings"
    folder.mkdir()
    write_chunks(folder, [[batch_of(0, 5)], [batch_of(5, 5)]], close=False)
    async with started(RecordSettings(folder=folder, sign=keys / "cell.key")) as recorder:
        await recorder.upkeep.recovered()
    ((_, state, problem),) = verify([folder], keys / "cell.pub")
    assert (state, problem) == ("repaired", "")


def test_a_seal_goes_with_its_file(keys: Path) -> None:
    given = {"file_size": 30e3, "keep": 120e3, "flush": 3600.0, "sign": keys / "cell.key"}
    asyncio.run(record(RecordSettings(folder=keys / "recordings", **given), 400))
    names = {p.name for p in (keys / "recordings").iterdir()}
    assert not [n for n in names if n.endswith("_000001.mcap")], "some were removed to keep to the budget"
    assert {n.removesuffix(".sig") for n in names if n.endswith(".sig")} == {n for n in names if n.endswith(".mcap")}


async def test_without_its_key_the_cell_records_and_says_so(keys: Path) -> None:
    (keys / "cell.key").unlink()
    async with started(RecordSettings(folder=keys / "recordings", sign=keys / "cell.key")) as recorder:
        assert recorder.put(batch_of(0, 10))
    assert "could not be signed: " in recorder.stats()["upkeep_problem"]
    assert len(Recording.open(keys / "recordings").paths) == 1
