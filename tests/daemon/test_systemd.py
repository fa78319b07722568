"""The notify client against a datagram socket that stands in for systemd's."""

from __future__ import annotations

import os
import re
import socket
import time
from pathlib import Path

import pytest

from cellwatt.runtime import systemd
from tests.patience import PATIENCE


@pytest.fixture(params=["path", "abstract"])
def supervisor(request, tmp_path: Path, monkeypatch):
    """A bound socket, its address in the environment as systemd writes it."""
    address = str(tmp_path / "notify") if request.param == "path" else f"@cellwatt-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind("\0" + address[1:] if address.startswith("@") else address)
        listening.settimeout(PATIENCE)
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        yield listening


def test_tells_all_fields_in_one_message(supervisor) -> None:
    assert systemd.notify(READY="1", STATUS="green: 4 of 4 sources up")
    assert supervisor.recv(4096) == b"READY=1\nSTATUS=green: 4 of 4 sources up"


def test_reloading_carries_the_monotonic_time_of_now(supervisor) -> None:
    before = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    assert systemd.reloading()
    after = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    match = re.fullmatch(rb"RELOADING=1\nMONOTONIC_USEC=(\d+)", supervisor.recv(4096))
    assert match is not None
    assert before <= int(match[1]) <= after


def test_a_text_that_is_no_utf_8_is_told_all_the_same(supervisor) -> None:
    assert systemd.notify(STATUS="amber: Stage heat failed: no file of \udcff")
    assert supervisor.recv(4096) == b"STATUS=amber: Stage heat failed: no file of ?"


def test_line_break_cannot_smuggle_a_field(supervisor) -> None:
    with pytest.raises(ValueError, match="one line"):
        systemd.notify(STATUS="fine\nMAINPID=1")
    supervisor.setblocking(False)
    with pytest.raises(BlockingIOError):
        supervisor.recv(4096)


@pytest.mark.parametrize("address", [None, "", "vsock:2:1234", "relative/path"])
def test_does_nothing_without_a_unix_socket(monkeypatch, address: str | None) -> None:
    if address is None:
        monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    else:
        monkeypatch.setenv("NOTIFY_SOCKET", address)
    assert not systemd.notify(READY="1")
    assert not systemd.reloading()


def test_supervisor_that_is_gone_is_one_warning(monkeypatch, tmp_path: Path, caplog) -> None:
    systemd._warn_once.cache_clear()
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "nobody"))
    for _ in range(3):
        assert not systemd.notify(WATCHDOG="1")
    assert caplog.text.count("does not listen") == 1
