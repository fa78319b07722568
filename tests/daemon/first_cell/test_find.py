"""Serial ports are seen without being opened."""

from __future__ import annotations

import os
import pty

import pytest
from serial.tools.list_ports_common import ListPortInfo

from cellwatt.first_cell import find


@pytest.fixture
def terminal():
    ours, theirs = pty.openpty()
    name = os.ttyname(theirs)
    os.close(theirs)
    yield name
    os.close(ours)


@pytest.fixture
def port(terminal, tmp_path, monkeypatch):
    lasting = tmp_path / "usb-Receiver-if00"
    lasting.symlink_to(terminal)
    monkeypatch.setattr(find, "BY_ID", tmp_path)
    found = ListPortInfo(terminal)
    found.description = "Receiver"
    monkeypatch.setattr(find, "comports", lambda: [found])
    return lasting


def test_a_free_port_has_its_lasting_name(port):
    assert find.serial_ports() == [find.SerialPort(str(port), "Receiver")]
