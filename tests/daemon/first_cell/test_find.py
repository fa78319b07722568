"""Serial ports are seen without being opened."""

from __future__ import annotations

import os
import pty

import pytest
import serial
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


def test_a_free_port_has_its_lasting_name(port, terminal, monkeypatch):
    monkeypatch.setattr(find, "_open_files", lambda: iter(()))
    assert find.serial_ports() == [find.SerialPort(str(port), "Receiver")]


def test_a_port_that_a_program_has_locked_is_in_use(port, terminal, monkeypatch):
    monkeypatch.setattr(find, "_open_files", lambda: iter(()))
    with serial.Serial(terminal, exclusive=True):
        assert find.serial_ports()[0].trouble == "in use by another program"
    assert find.serial_ports()[0].trouble == ""


def test_a_port_that_a_program_has_open_is_in_use(port, terminal):
    handle = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    try:
        assert find.serial_ports()[0].trouble == "in use by another program"
    finally:
        os.close(handle)
