"""Frames on their way to samples."""

from __future__ import annotations

import os
import pty
import tty

import pytest
from can import Message

from cellwatt_drivers.can_sensor.intake import Intake
from cellwatt_drivers.can_sensor.sensor_map import load_decodings
from cellwatt_drivers.can_sensor.slcan import CountingSlcanBus

from ..outlet import CollectingOutlet

LINES = [b"t521\r", b"T0000\r", b"t\r", b"?\r", b"t521\xff\r"]
DBC = """VERSION ""
BU_: Vector__XXX
BO_ 16 A: 8 Vector__XXX
 SG_ M M : 0|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ U m1 : 8|16@1+ (0.1,0) [0|0] "V" Vector__XXX
 SG_ W m2 : 8|16@1+ (1,0) [0|0] "W" Vector__XXX
"""
MAP = "maker: M\nmodel: N\ndbc: a.dbc\nstreams:\n  a: {message: A, signals: {U: bus.voltage}}\n"


async def test_a_multiplexed_message_that_carries_others_is_no_sample(tmp_path):
    (tmp_path / "a.dbc").write_text(DBC)
    (tmp_path / "a.yaml").write_text(MAP)
    _, decodings = load_decodings(None, tmp_path / "a.yaml")
    outlet = CollectingOutlet()
    intake = Intake("sensor", decodings["a"], 0.0, outlet)
    for second, multiplexer in enumerate((1, 2, 1, 3)):
        intake.take(Message(arbitration_id=16, data=[multiplexer, 10, 0, 0, 0, 0, 0, 0], timestamp=100.0 + second))
    intake.flush(outlet.now())
    assert outlet.values.tolist() == [[1.0], [1.0]]
    assert outlet.account.counters["frames without the signals"] == 1
    assert outlet.account.counters["malformed"] == 1  # a multiplexer that the file does not know
    assert outlet.account.residue == 0


@pytest.mark.parametrize("line", LINES)
def test_a_line_that_was_cut_on_the_serial_port_costs_itself_alone(line):
    master, slave = pty.openpty()
    tty.setraw(slave)
    bus = CountingSlcanBus(os.ttyname(slave), sleep_after_open=0)
    try:
        os.write(master, line + b"t5211ff\r")
        found = None
        while found is None:
            found = bus.recv(1)
        assert (found.arbitration_id, bytes(found.data), bus.malformed) == (0x521, b"\xff", 1)
    finally:
        bus.shutdown()
        os.close(master)
        os.close(slave)
