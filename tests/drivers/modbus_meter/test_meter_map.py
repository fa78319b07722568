from __future__ import annotations

from importlib.resources import files

import pytest

from cellwatt.errors import ConfigError
from cellwatt_drivers.modbus_meter.meter_map import METERS, chosen_map, packaged_map

GOOD = """
maker: Acme
model: A1
function: input
type: float32
values:
  supply.power: {address: 0x10, unit: kW}
  supply.power_factor: {address: 0x12, unit: 1}
  supply.energy: {address: 0x14, type: uint32, unit: Wh, scale: 10}
"""


def test_every_packaged_map_has_a_name_and_reads_power_and_energy():
    folder = files("cellwatt_drivers.modbus_meter") / "meters"
    assert sorted(f.name.removesuffix(".yaml") for f in folder.iterdir()) == sorted(METERS)
    for name in METERS:
        made = packaged_map(name)
        assert {"supply.power", "supply.energy_imported", "phase_3.voltage", "phase_1.current"} <= set(made.values)
        assert made.source
        assert any(v.between for v in made.values.values()), "what tells a wrong word order"


# Addresses from the fact sheets, not from the maps.
@pytest.mark.parametrize(
    ("meter", "channel", "address", "kind", "unit", "function", "order"),
    [
        ("eastron_sdm630", "supply.power", 0x34, "float32", 1.0, "input", "big"),
        ("gavazzi_em340", "supply.energy_imported", 0x34, "int32", 3.6e5, "input", "little"),
        ("schneider_iem3000", "supply.energy_imported", 0x0C83, "int64", 3.6e3, "holding", "big"),
        ("schneider_pm5000", "phase_3.current", 3003, "float32", 1.0, "holding", "big"),
        ("siemens_pac2200", "supply.energy_imported", 801, "float64", 3.6e3, "input", "big"),
        ("siemens_pac3200", "supply.energy_imported", 801, "float64", 3.6e3, "holding", "big"),
        ("shelly_pro_3em", "supply.energy_exported", 1164, "float32", 3.6e3, "input", "little"),
    ],
)
def test_what_the_manuals_say(meter, channel, address, kind, unit, function, order):
    made = packaged_map(meter)
    value = made.values[channel]
    assert (value.address, value.type or made.type, made.function, made.word_order) == (address, kind, function, order)
    assert value.factor == pytest.approx(unit)


def test_an_own_map(tmp_path):
    file = tmp_path / "a1.yaml"
    file.write_text(GOOD)
    made = chosen_map(None, file)
    assert made.values["supply.power"].channel("supply.power").unit == "W"
    assert made.values["supply.power_factor"].unit == "1"
    assert made.wrap("supply.energy") == pytest.approx(2**32 * 10 * 3600.0)
    assert made.values["supply.energy"].channel("supply.energy").kind == "counter"
    assert made.window == 0.0
    file.write_text("window: 0.5\n" + GOOD)
    assert chosen_map(None, file).window == 0.5


@pytest.mark.parametrize(
    ("old", "new", "place", "why"),
    [
        ("unit: kW", "unit: horse", "7:39", "found 'horse': 'horse' is not a unit"),
        ("unit: kW", "unit: degF", "7:39", "'degF' has a different zero than degC"),
        ("address: 0x12", "address: -1", "8:34", "at least 0"),
        ("address: 0x12", "address: 0x11", "", "begins within supply.power"),
        ("0x14, type: uint32", "65535, type: uint32", "", "beyond register 65535"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path, old, new, place, why):
    file = tmp_path / "a1.yaml"
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError, match=why) as caught:
        chosen_map(None, file)
    places = [p.place.removeprefix(f"{file}:") for p in caught.value.problems]
    assert not place or set(places) & set(place.split("|")), (places, str(caught.value))


@pytest.mark.parametrize(
    ("value", "marks"),
    [
        ("type: uint16", (0xFFFF,)),
        ("type: int16", (-0x8000,)),
        ("type: float32", ()),
        ("type: uint16, missing: []", ()),
        ("type: int32, missing: [7]", (7,)),
    ],
)
def test_numbers_that_stand_for_no_value(tmp_path, value, marks):
    file = tmp_path / "map.yaml"
    head = "maker: A\nmodel: B\nfunction: input\ntype: float64\nvalues:\n"
    file.write_text(f"{head}  supply.power: {{address: 0, unit: W, {value}}}\n")
    assert chosen_map(None, file).marks("supply.power") == marks
