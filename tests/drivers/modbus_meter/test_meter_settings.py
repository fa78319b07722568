from __future__ import annotations

from importlib.machinery import PathFinder

import pytest

from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver, ModbusMeterSettings
from cellwatt_drivers.shared import requirements

from ..inlet import CollectingInlet

GOOD = {"host": "192.0.2.1", "meter": "siemens_pac3200"}


def make(**changes):
    return ModbusMeterDriver("m", ModbusMeterSettings.model_validate(GOOD | changes), CollectingInlet())


def test_powers_are_declared_as_means_where_somebody_says_so():
    (plain,), (told,) = make().streams, make(window="200 ms").streams
    assert {c.window for c in plain.channels} == {0.0}
    assert {c.unit for c in told.channels if c.window} == {"W", "VA", "var"}
    assert {c.window for c in told.channels if c.window} == {0.2}


def test_only_what_is_wanted_is_read_in_the_order_of_the_settings():
    (stream,) = make(read=["supply.power", "phase_1.voltage"], rate="10 Hz").streams
    assert stream.names == ("supply.power", "phase_1.voltage")
    with pytest.raises(ConfigError, match=r"read: a PAC3200 has no supply\.torque.* \(it has: phase_1\.voltage"):
        make(read=["supply.torque"])


SERIAL = "{driver: modbus_meter, meter: eastron_sdm630, line: /dev/ttyS0, unit: %d}"
CELL = f"site: a\ncell: b\nsources:\n  oven: {SERIAL % 1}\n  press: {SERIAL % 2}\n  fan: {SERIAL % 3}\n"


@pytest.mark.parametrize(
    ("change", "way"),
    [
        ("line: /dev/ttyS0, parity: none", "/dev/ttyS0, baud 9600, parity none, stop_bits 1"),
        ("line: /dev/ttyS0, baud: 19200", "/dev/ttyS0, baud 19200, parity even, stop_bits 1"),
        ("line: /dev/ttyS0, stop_bits: 2", "/dev/ttyS0, baud 9600, parity even, stop_bits 2"),
        ("line: /dev/../dev/ttyS0", "/dev/../dev/ttyS0, baud 9600, parity even, stop_bits 1"),
    ],
)
def test_a_line_is_opened_in_one_way_by_all_its_meters(tmp_path, change, way):
    file = tmp_path / "cell.yaml"
    file.write_text(CELL)
    assert len(load(file).sources) == 3
    file.write_text(CELL.replace("line: /dev/ttyS0, unit: 3", f"{change}, unit: 3"))
    with pytest.raises(ConfigError) as refused:
        load(file)
    its = "'oven' opens the same line as /dev/ttyS0, baud 9600, parity even, stop_bits 1"
    place = f"{file}:6:3: sources.fan"
    assert str(refused.value) == f"{place}: opens its serial line as {way}; {its}: write the same"


def test_a_missing_extra_is_named(monkeypatch):
    def nothing(name: str) -> object:
        return None if name == "pymodbus" else PathFinder.find_spec(name)

    monkeypatch.setattr(requirements, "find_spec", nothing)
    with pytest.raises(ConfigError, match=r"pip install 'cellwatt\[modbus\]'"):
        make()
