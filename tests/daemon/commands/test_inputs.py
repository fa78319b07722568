"""A command's input is a path, or a URL that is fetched: here from a store that speaks S3, beside this process."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread

import click
import pytest
from click.testing import CliRunner, Result

from cellwatt import CellwattError
from cellwatt.commands.options import INPUT
from tests.daemon.outlets.historian.bucket import Bucket

KEY = "plant/runs/run-1.mcap"


@pytest.fixture
def s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """A bucket "lake" with recordings, on an event loop of its own."""
    found: list[Bucket] = []
    begun, over = Event(), asyncio.Event()
    loops: list[asyncio.AbstractEventLoop] = []

    async def serve() -> None:
        loops.append(asyncio.get_running_loop())
        async with Bucket().open() as served:
            found.append(served)
            begun.set()
            await over.wait()

    thread = Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    begun.wait()
    found[0].objects |= {KEY: b"first" * 1000, "plant/runs/run-2.mcap": b"second"}
    settings = {
        "AWS_ENDPOINT_URL_S3": found[0].url,
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_EC2_METADATA_DISABLED": "true",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    yield found[0]
    loops[0].call_soon_threadsafe(over.set)
    thread.join()


@click.command()
@click.argument("paths", nargs=-1, type=INPUT)
def command(paths: tuple[Path, ...]) -> None:
    for path in paths:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        for file in files:
            click.echo(f"{file.name} {len(file.read_bytes())}")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)


def test_a_path_is_a_path(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"abc")
    assert run(tmp_path / "a.mcap").output == "a.mcap 3\n"
    missing = run(tmp_path / "b.mcap")
    assert missing.exit_code == 2 and "does not exist" in missing.output
    assert run(f"file://{tmp_path}/a.mcap").output == "a.mcap 3\n"


def test_an_object_of_s3_is_fetched_once(s3: Bucket) -> None:
    assert run(f"s3://lake/{KEY}").output == "run-1.mcap 5000\n"
    assert run(f"s3://lake/{KEY}").output == "run-1.mcap 5000\n"
    assert len([line for line in s3.log if line == f"GET {KEY}"]) == 1


def test_a_folder_of_s3_is_fetched(s3: Bucket) -> None:
    assert run("s3://lake/plant/runs").output == "run-1.mcap 5000\nrun-2.mcap 6\n"


def test_a_store_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch, s3: Bucket) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", "http://127.0.0.1:9")
    with pytest.raises(CellwattError, match=r"^s3://lake/plant/x cannot be fetched: .*connect"):
        run("s3://lake/plant/x")
