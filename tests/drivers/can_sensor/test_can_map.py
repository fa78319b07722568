from __future__ import annotations

import pytest

from cellwatt.errors import ConfigError
from cellwatt_drivers.can_sensor.sensor_map import load_decodings

DBC = """VERSION ""
BU_: DRIVE
BO_ 256 Drive_Status: 8 DRIVE
 SG_ Speed : 0|16@1- (1,0) [0|0] "rpm" Vector__XXX
 SG_ Energy : 16|32@1+ (1,0) [0|0] "Wh" Vector__XXX
 SG_ Odd : 48|8@1+ (1,0) [0|0] "furlong" Vector__XXX
 SG_ Number : 56|8@1+ (1,0) [0|0] "" Vector__XXX
"""
GOOD = """
maker: Acme
model: Drive
dbc: drive.dbc
streams:
  status:
    message: Drive_Status
    cycle: 10 ms
    counter: Number
    signals:
      Speed: drive.speed
      Energy: {channel: drive.energy, counter: true}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "drive.dbc").write_text(DBC)
    (tmp_path / "drive.yaml").write_text(GOOD)
    return tmp_path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_a_unit_is_read_in_any_encoding(folder, encoding):
    (folder / "drive.dbc").write_text(DBC.replace("furlong", "°C"), encoding=encoding)
    (folder / "drive.yaml").write_text(GOOD + "      Odd: drive.temperature\n")
    _, decodings = load_decodings(None, folder / "drive.yaml")
    assert decodings["status"].channels[-1].unit == "degC"


def test_the_worked_frame_of_an_ivt_s():
    _, decodings = load_decodings("ivt_s", None)
    current = decodings["current"]
    assert (current.message.frame_id, current.counter) == (0x521, (16, 16, False))
    found = current.decode(bytes.fromhex("00 45 FF FE 1D C0"))
    assert found["I"] * current.factors[0] == pytest.approx(-123.456)  # -123 456 mA
    assert (found["I_Counter"], found["I_Measurement_Error"], found["I_Channel_Error"]) == (5, 1, 0)


@pytest.mark.parametrize(
    ("stream", "identifier", "data", "channel", "unit", "value"),
    [
        ("voltage_1", 0x522, "01 00 00 00 BB 80", "bus.voltage", "V", 48.0),
        ("power", 0x526, "05 00 FF FF FC 18", "bus.power", "W", -1000.0),
        ("energy", 0x528, "07 00 00 00 00 02", "bus.energy", "J", 7200.0),
    ],
)
def test_results_of_an_ivt_s(stream, identifier, data, channel, unit, value):
    _, decodings = load_decodings("ivt_s", None)
    found = decodings[stream]
    assert found.message.frame_id == identifier
    assert (found.channels[0].name, found.channels[0].unit) == (channel, unit)
    signals = found.decode(bytes.fromhex(data))
    assert signals[next(iter(found.wanted.signals))] * found.factors[0] == pytest.approx(value)


PAGES = """VERSION ""
BU_: DRIVE
BO_ 256 Drive_Status: 8 DRIVE
 SG_ Page M : 0|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Speed m0 : 8|16@1- (1,0) [0|0] "rpm" Vector__XXX
 SG_ Energy m1 : 8|32@1+ (1,0) [0|0] "Wh" Vector__XXX
 SG_ Number : 56|8@1+ (1,0) [0|0] "" Vector__XXX
"""
AGAIN = "  again:\n    message: Drive_Status\n    signals: {{{}}}\n"
NEVER = "stream status: no frame of Drive_Status carries both Energy and Speed, .* different pages of Page: write a"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("cycle: 10 ms", "cycle: 10", r"drive\.yaml:8:12: streams\.status\.cycle: .*number with its unit"),
        ("dbc: drive.dbc", "dbc: driv.dbc", r"driv\.dbc: cannot be read as a DBC file"),
        ("Drive_Status", "Drive_Statu", "no message 'Drive_Statu'; did you mean 'Drive_Status'"),
        ("Speed:", "Sped:", "no signal 'Sped'; did you mean 'Speed'"),
        ("Speed: drive.speed", "Odd: drive.odd", "signal Odd of Drive_Status is in 'furlong': write"),
        ("Speed: drive.speed", "Speed: Speed", r"drive\.yaml:11:"),
        (GOOD, GOOD + AGAIN.format("Speed: drive.speed_2"), "each message feeds one stream"),
        (DBC, PAGES, NEVER),
    ],
)
def test_mistakes_say_where_and_what(folder, old, new, why):
    assert old in GOOD or old == DBC
    (folder / "drive.dbc").write_text(new if old == DBC else DBC)
    (folder / "drive.yaml").write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError, match=why):
        load_decodings(None, folder / "drive.yaml")


def test_a_stream_for_each_page_of_a_message(folder):
    (folder / "drive.dbc").write_text(PAGES)
    alone = GOOD.replace("      Energy: {channel: drive.energy, counter: true}\n", "")
    (folder / "drive.yaml").write_text(alone + AGAIN.format("Energy: drive.energy"))
    _, decodings = load_decodings(None, folder / "drive.yaml")
    assert {name: dict(d.pages) for name, d in decodings.items()} == {"status": {"Page": {0}}, "again": {"Page": {1}}}
