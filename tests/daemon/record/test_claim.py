from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cellwatt import RecordingError
from cellwatt.record.folder import LOCK, claimed
from tests.patience import PATIENCE

HOLD = """
import os, sys, time
from pathlib import Path
from cellwatt.record.folder import claimed
with claimed(Path(sys.argv[1]), "weld-3"):
    child = os.fork()
    if not child:
        time.sleep(1000)
    print(child, flush=True)
    sys.stdin.read()
"""


@contextmanager
def another(folder: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A process that holds the folder until its input ends, and one that it forked, which outlives it."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    child = int(process.stdout.readline())
    try:
        yield process, child
    finally:
        os.kill(child, signal.SIGKILL)
        process.kill()
        process.wait(PATIENCE)
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            stream.close()


def test_a_folder_that_another_has(tmp_path: Path) -> None:
    folder = tmp_path / "record"
    with another(folder) as (other, _):
        with pytest.raises(RecordingError) as caught, claimed(folder, "mine"):
            pass
        assert len(str(caught.value).splitlines()) == 1
        assert f"record.folder {folder} is in use" in str(caught.value)
        assert f"cell weld-3, process {other.pid} on " in str(caught.value)
        with claimed(tmp_path / "other", "mine"):
            pass
        assert other.stdin is not None
        other.stdin.close()
        other.wait(PATIENCE)
        with claimed(folder, "mine"):
            assert f"cell mine, process {os.getpid()} on " in (folder / LOCK).read_text()


def test_a_dead_one_holds_up_nobody(tmp_path: Path) -> None:
    """Neither does what it forked, which may take a while to end."""
    with another(tmp_path) as (other, child):
        with pytest.raises(RecordingError), claimed(tmp_path, "mine"):
            pass
        other.kill()
        other.wait(PATIENCE)
        with claimed(tmp_path, "mine"):
            os.kill(child, 0)  # it is still there


@pytest.mark.parametrize("text", ["\x1b[31mforged\nlines", "x" * 100_000, ""])
def test_what_stands_in_the_lock_cannot_forge_lines(tmp_path: Path, text: str) -> None:
    with another(tmp_path):
        (tmp_path / LOCK).write_text(text)
        with pytest.raises(RecordingError) as caught, claimed(tmp_path, "mine"):
            pass
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 600


def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    treasure = tmp_path / "treasure"
    treasure.write_text("do not touch")
    folder = tmp_path / "record"
    folder.mkdir()
    (folder / LOCK).symlink_to(treasure)
    with caplog.at_level(logging.WARNING), claimed(folder, "mine"):
        pass
    assert treasure.read_text() == "do not touch"
    assert "cannot be locked against a second daemon" in caplog.text
