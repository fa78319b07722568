from __future__ import annotations

from importlib.machinery import PathFinder

import pytest

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


def test_a_missing_extra_is_named(monkeypatch):
    def nothing(name: str) -> object:
        return None if name == "pymodbus" else PathFinder.find_spec(name)

    monkeypatch.setattr(requirements, "find_spec", nothing)
    with pytest.raises(ConfigError, match=r"pip install 'cellwatt\[modbus\]'"):
        make()
