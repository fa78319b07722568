"""``cellwatt run`` as processes: signals, systemd, the log."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

from cellwatt.record import Recording
from cellwatt.results import Prediction
from tests.daemon.commands.calling import CELL, Ended, cell
from tests.patience import PATIENCE

__all__ = ["cell"]


class Systemd:
    """Takes what it is told at once, as systemd does: the kernel keeps ten messages."""

    def __init__(self, path: Path) -> None:
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self._path)
        self._fields: list[str] = []
        self._listening = Thread(target=self._listen)
        self._listening.start()

    def _listen(self) -> None:
        with self._socket:
            while message := self._socket.recv(4096):
                self._fields.append(message.decode().split("\n")[0])

    def heard(self) -> list[str]:
        """First fields of what it was told until now, in order, without the signs of life."""
        if self._listening.is_alive():
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
                end.sendto(b"", self._path)
            self._listening.join()
        return [field for field in self._fields if field != "WATCHDOG=1"]


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Systemd]:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    listening = Systemd(tmp_path / "notify")
    yield listening
    listening.heard()


def run(scenario: str, cell: Path) -> Ended:
    """The daemon of a cell, which records beside it, from start to end; its log is ``err``."""
    log = cell.with_suffix(".log")
    cell.write_text(cell.read_text() + f"record: {{folder: {cell.parent / 'kept'}}}\n")
    with log.open("w") as err:
        done = subprocess.run(
            [sys.executable, "-m", "tests.daemon.commands.fake_run", scenario, str(cell)],
            stdout=subprocess.PIPE,
            stderr=err,
            text=True,
            timeout=PATIENCE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            check=False,
        )
    return Ended(done.returncode, done.stdout, log.read_text())


def values(cell: Path, source: str) -> list[int]:
    """Numbers of the samples that were recorded, in order."""
    return [int(v) for v in Recording.open(cell.parent / "kept").batches(source, "supply").values[:, 0]]


@pytest.mark.parametrize("signal", ["SIGTERM", "SIGINT"])
def test_a_signal_ends_it_in_order(cell: Path, systemd: Systemd, signal: str) -> None:
    ended = run(signal, cell)
    assert (ended.code, ended.out) == (0, "")
    assert values(cell, "arm") == [0, 1, 2, 3, 4]
    assert systemd.heard() == ["READY=1", "STOPPING=1"]
    assert not list((cell.parent / "kept").glob("*.part"))
    assert "WARNING" not in ended.err
    assert "ERROR" not in ended.err


def test_a_hangup_applies_what_changed(cell: Path, systemd: Systemd) -> None:
    ended = run("one source more", cell)
    assert ended.code == 0
    assert ended.err.count("arm: Maker Model 2.3 answers") == 1
    assert values(cell, "board") == [0, 1]
    assert systemd.heard() == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]
    kinds = [event.kind for event in Recording.open(cell.parent / "kept").events()]
    assert kinds == ["connected", "reloaded", "connected"] or kinds == ["connected", "connected", "reloaded"]


def test_hangups_during_a_reload_are_one_more_and_the_last_file_wins(cell: Path, systemd: Systemd) -> None:
    ended = run("a hundred hangups", cell)
    assert ended.code == 0
    assert values(cell, "board") == [0, 1]
    told = systemd.heard()
    assert told.count("RELOADING=1") == told.count("READY=1") - 1 < 100


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        ("not YAML", "weld.yaml:1:8: not valid YAML"),
        ("another site", "a change of site needs a restart"),
        ("new stage aborts", "the process judge abort ended by signal SIGABRT; nothing was changed"),
    ],
)
def test_a_hangup_with_a_mistake_changes_nothing(cell: Path, systemd: Systemd, scenario: str, words: str) -> None:
    ended = run(scenario, cell)
    assert ended.code == 0
    assert words in ended.err
    assert "not reloaded, the old settings stay in force:\n" in ended.err
    assert ended.err.count("arm: Maker Model 2.3 answers") == 1
    assert values(cell, "arm") == [0, 1, 2]
    assert "Traceback" not in ended.err
    assert systemd.heard() == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]


def test_a_stage_that_does_not_fit_is_told_before_anything_is_opened(cell: Path) -> None:
    cell.write_text(CELL + "stages: {judge: {}}\n")
    ended = run("stage does not fit", cell)
    assert ended.code == 2
    assert ended.err.endswith(f"{cell}:5:10: stages.judge: the model is of another robot\n")
    assert "answers" not in ended.err


@pytest.mark.parametrize(
    ("scenario", "told"),
    [
        ("stage aborts", "the process judge judge ended by signal SIGABRT"),
        pytest.param("stage grows", "stage judge failed; it is created again", marks=pytest.mark.slow),
        ("stage holds the interpreter", "held for 1 s"),
    ],
)
def test_a_stage_that_breaks_its_process_breaks_nothing_else(cell: Path, scenario: str, told: str) -> None:
    cell.write_text(CELL + "stages: {judge: {}, other: {stage: judge}}\n")
    ended = run(scenario, cell)
    assert ended.code == 0
    assert values(cell, "arm") == list(range(150))
    kept = Recording.open(cell.parent / "kept")
    frames = [block.sequence for block in kept.frames()]
    predicted = [p.sequence for p in kept.results() if isinstance(p, Prediction) and p.model == "other"]
    assert predicted == frames
    assert told in ended.err
