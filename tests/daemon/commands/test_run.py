"""``cellwatt run`` in this process: signals, systemd, the log."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from cellwatt.commands import run
from tests.daemon.commands.calling import CELL, Call, call, cell
from tests.daemon.runtime.fakes import DEVICES, JUDGES, RECEIVERS, answer, give, until

__all__ = ["call", "cell"]


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    """What the daemon sets for its process."""
    interval = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval)
    gc.unfreeze()


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listening


def heard(systemd: socket.socket) -> list[str]:
    """First fields of what systemd was told, in order, each run of them once."""
    found: list[str] = []
    while True:
        try:
            field = systemd.recv(4096).decode().split("\n")[0]
        except BlockingIOError:
            return found
        if not found or found[-1] != field:
            found.append(field)


def send(number: signal.Signals):
    async def order(_):
        os.kill(os.getpid(), number)

    return order


def write(file: Path, text: str):
    async def order(_):
        await asyncio.to_thread(file.write_text, text)

    return order


def logged(caplog: pytest.LogCaptureFixture, words: str):
    async def order(_):
        await until(lambda: words in caplog.text)

    return order


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_in_order(call: Call, cell: Path, systemd: socket.socket, number: signal.Signals) -> None:
    DEVICES["arm"].tell(answer, give(5), send(number))
    ended = call("run", cell)
    assert (ended.code, ended.out) == (0, "")
    assert RECEIVERS["zenoh"].values == [0, 1, 2, 3, 4]
    assert DEVICES["arm"].open == RECEIVERS["zenoh"].open == 0
    told = heard(systemd)
    assert [told[0], told[1], told[-2]] == ["WATCHDOG=1", "READY=1", "STOPPING=1"]
    assert told[-1] == "WATCHDOG=1", "it lives while it ends"


def test_a_hangup_applies_what_changed(call: Call, cell: Path, systemd: socket.socket, caplog) -> None:
    caplog.set_level("INFO")
    more = write(cell, CELL + "  board: {driver: fake, host: board}\n")
    DEVICES["arm"].tell(answer, more, send(signal.SIGHUP))
    DEVICES["board"].tell(answer, give(2), logged(caplog, "reloaded: source board"), send(signal.SIGTERM))
    assert call("run", cell).code == 0
    assert len(DEVICES["arm"].runs) == 1
    assert RECEIVERS["zenoh"].values == [0, 1]
    assert [f for f in heard(systemd) if f != "WATCHDOG=1"] == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]


def test_hangups_during_a_reload_are_one_more_and_the_last_file_wins(
    call: Call, cell: Path, caplog, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level("INFO")
    loads, go_on, load = [], threading.Event(), run.load

    def slow_load(path: Path):
        loads.append(path)
        if len(loads) > 1:  # the first is that of the start
            assert go_on.wait(60)
        return load(path)

    async def reading(_):
        await until(lambda: len(loads) > 1)

    async def let_go(_):
        go_on.set()

    monkeypatch.setattr(run, "load", slow_load)
    more = write(cell, CELL + "  board: {driver: fake, host: board}\n")
    DEVICES["arm"].tell(answer, send(signal.SIGHUP), reading, *[send(signal.SIGHUP)] * 100, more, let_go)
    DEVICES["board"].tell(answer, give(2), logged(caplog, "reloaded: source board"), send(signal.SIGTERM))
    assert call("run", cell).code == 0
    assert len(loads) <= 3
    assert RECEIVERS["zenoh"].values == [0, 1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("site: [", "weld.yaml:1:8: not valid YAML"),
        (CELL.replace("fake", "fakes"), "no driver named 'fakes'; did you mean 'fake'?"),
        (CELL + "stages: {judge: {}}\n", "stages.judge: the model is of another robot"),
        (CELL.replace("site: plant", "site: other"), "not reloaded: a change of site needs a restart"),
    ],
)
def test_a_hangup_with_a_mistake_changes_nothing(
    call: Call, cell: Path, systemd: socket.socket, caplog, text: str, words: str
) -> None:
    JUDGES["judge"].refuse = ValueError("the model is of another robot")
    DEVICES["arm"].tell(answer, write(cell, text), send(signal.SIGHUP), logged(caplog, "not reloaded"))
    DEVICES["arm"].tell(give(3), send(signal.SIGTERM))
    assert call("run", cell).code == 0
    assert words in caplog.text
    assert ("the old settings stay in force:\n" in caplog.text) == ("restart" not in words)
    assert len(DEVICES["arm"].runs) == 1
    assert RECEIVERS["zenoh"].values == [0, 1, 2]
    assert "Traceback" not in caplog.text
    assert [f for f in heard(systemd) if f != "WATCHDOG=1"] == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]


def test_a_stage_that_does_not_fit_is_told_before_anything_is_opened(call: Call, cell: Path) -> None:
    JUDGES["judge"].refuse = ValueError("the model is of another robot")
    cell.write_text(CELL + "stages: {judge: {}}\n")
    ended = call("run", cell)
    assert ended.code == 2
    assert ended.err == f"{cell}:5:10: stages.judge: the model is of another robot\n"
    assert not DEVICES["arm"].runs
