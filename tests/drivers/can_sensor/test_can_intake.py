"""Frames on their way to samples."""

from __future__ import annotations

import os
import pty
import tty
from types import SimpleNamespace

import pytest
from can import Message

from cellwatt_drivers.can_sensor import intake as can_intake
from cellwatt_drivers.can_sensor.intake import Intake
from cellwatt_drivers.can_sensor.sensor_map import load_decodings
from cellwatt_drivers.can_sensor.slcan import CountingSlcanBus

from ..inlet import CollectingInlet

LINES = [b"t521\r", b"T0000\r", b"t\r", b"?\r", b"t521\xff\r"]
DBC = """VERSION ""
BU_: Vector__XXX
BO_ 16 A: 8 Vector__XXX
 SG_ M M : 0|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ U m1 : 8|16@1+ (0.1,0) [0|0] "V" Vector__XXX
 SG_ W m2 : 8|16@1+ (1,0) [0|0] "W" Vector__XXX
"""
MAP = "maker: M\nmodel: N\ndbc: a.dbc\nstreams:\n  a: {message: A, signals: {%s}}\n"
NESTED = """VERSION ""
BU_: Vector__XXX
BO_ 16 A: 8 Vector__XXX
 SG_ M M : 0|8@1+ (2,0) [0|0] "" Vector__XXX
 SG_ I : 56|8@1+ (1,0) [0|0] "A" Vector__XXX
 SG_ S m1M : 8|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ U m3 : 16|16@1+ (0.1,0) [0|0] "V" Vector__XXX
 SG_ W m2 : 8|16@1+ (1,0) [0|0] "W" Vector__XXX
SG_MUL_VAL_ 16 S M 1-1;
SG_MUL_VAL_ 16 U S 3-3, 5-7;
SG_MUL_VAL_ 16 W M 2-4;
"""


def taken(folder, frames, signals="U: bus.voltage", dbc=DBC):
    """What an intake gives for frames that come one a second."""
    (folder / "a.dbc").write_text(dbc)
    (folder / "a.yaml").write_text(MAP % signals)
    _, decodings = load_decodings(None, folder / "a.yaml")
    inlet = CollectingInlet()
    intake = Intake("sensor", decodings["a"], 0.0, inlet)
    for second, data in enumerate(frames):
        intake.take(Message(arbitration_id=16, data=data, timestamp=100.0 + second), inlet.now())
    intake.flush(inlet.now())
    assert inlet.account.residue == 0
    return inlet


@pytest.mark.parametrize("batch", [1, 40])
def test_a_clock_of_the_pc_that_is_set_on_is_one_reset_and_no_loss(monkeypatch, batch):
    inlet, clock = CollectingInlet(), SimpleNamespace(time_ns=lambda: round((1000.0 + 0.02 * number + ahead) * 1e9))
    monkeypatch.setattr(can_intake, "time", clock)
    inlet.now = lambda: round((1000.0 + 0.02 * number) * 1e9)
    intake = Intake("sensor", load_decodings("ivt_s", None)[1]["current"], 0.02, inlet)
    for number in range(120):
        ahead = 0.0 if number < 40 else 10.0
        data = bytes([0, number % 16, 0, 0, 0, 1])
        intake.take(Message(arbitration_id=0x521, data=data, timestamp=1000.0 + 0.02 * number + ahead), inlet.now())
        if number % batch == batch - 1:
            intake.flush(inlet.now())
    assert inlet.account.expected == 120
    assert inlet.resets == ["the PC's clock jumped by 10.000 s"]


def test_a_clock_of_the_pc_that_is_set_back_amid_a_block_sets_no_arrival_back():
    inlet = CollectingInlet()
    intake = Intake("sensor", load_decodings("ivt_s", None)[1]["current"], 0.02, inlet)
    arrival = inlet.now()
    for number, second in enumerate((1000.0, 10.0)):
        intake.take(Message(arbitration_id=0x521, data=bytes([0, number, 0, 0, 0, 1]), timestamp=second), arrival)
    intake.flush(arrival)
    assert [(len(r.values), r.arrival) for r in inlet.readings] == [(1, arrival)] * 2
    assert inlet.resets == ["the PC's clock was set back by 990.000 s"]


def values(inlet):
    return inlet.values.tolist() if inlet.readings else []


async def test_frames_with_other_pages_and_with_unknown_ones_are_no_samples(tmp_path):
    inlet = taken(tmp_path, [[page, 10, 0, 0, 0, 0, 0, 0] for page in (1, 2, 1, 3)])
    assert values(inlet) == [[1.0], [1.0]]
    assert inlet.account.counters == {"frames without the signals": 2}


@pytest.mark.parametrize(
    ("data", "found"),
    [([1, 10, 0], 1), ([1, 10, 0, 9, 9, 9, 9, 9, 9, 9, 9, 9], 1), ([1, 10], "malformed"), ([], "malformed"), ([2], 0)],
)
async def test_a_frame_may_be_shorter_and_longer_than_the_file_says(tmp_path, data, found):
    inlet = taken(tmp_path, [data])
    assert values(inlet) == ([[1.0]] if found == 1 else [])
    assert inlet.account.counters["malformed"] == (found == "malformed")
    assert inlet.account.counters["frames without the signals"] == (found == 0)


async def test_signals_beyond_a_short_frame_are_missing(tmp_path):
    inlet = taken(tmp_path, [[2, 10, 0, 7, 0, 0, 0, 3], [2, 10, 0]], "I: bus.current, W: bus.power", NESTED)
    assert repr(values(inlet)) == "[[3.0, 10.0], [nan, 10.0]]"
    assert inlet.account.counters == {"signals beyond a short frame": 1}


async def test_pages_within_pages_and_ranges_of_them(tmp_path):
    frames = [[1, s, 10, 0, 0, 0, 0, 9] for s in (3, 4, 5, 7)] + [[5, 3, 10, 0, 0, 0, 0, 9]]
    inlet = taken(tmp_path, frames, "U: bus.voltage, I: bus.current", NESTED)
    assert values(inlet) == [[1.0, 9.0]] * 3
    assert inlet.account.counters == {"frames without the signals": 2}
    inlet = taken(tmp_path, [[page, 1, 0, 0, 0, 0, 0, 0] for page in range(6)], "W: bus.power", NESTED)
    assert values(inlet) == [[1.0]] * 3


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
