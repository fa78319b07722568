"""Units for people: conversions against values from elsewhere, and back."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.channel import UNITS
from cellwatt.units import TABLE, Units

ALL = [(kind, name) for kind, units in TABLE.items() for name in units]


@pytest.mark.parametrize(
    ("si", "value", "name", "shown"),
    [
        # The SI Brochure (9th edition), tables 6 and 8, and NIST SP 811, appendix B.8.
        ("J", 3.6e6, "kWh", 1.0),
        ("W", 745.69987, "kW", 0.74569987),
        ("rad", math.pi, "deg", 180.0),
        ("rad/s", 1.0, "rpm", 9.549296585513720),
        ("rad/s", 1.0, "deg/s", 57.29577951308232),
        ("degC", 100.0, "degF", 212.0),
        ("degC", 0.0, "K", 273.15),
        ("Pa", 101325.0, "bar", 1.01325),
        ("Nm", 0.25, "mNm", 250.0),
        ("m", 0.3048, "mm", 304.8),
    ],
)
def test_values_are_those_of_the_standards(si: str, value: float, name: str, shown: float) -> None:
    unit = Units().but([name]).of(si)
    assert unit.name == name
    assert unit.of([value]) == pytest.approx([shown], rel=1e-15, abs=1e-13)


@given(chosen=st.sampled_from(ALL), value=st.floats(-1e9, 1e9))
def test_a_value_comes_back(chosen: tuple[str, str], value: float) -> None:
    kind, name = chosen
    unit = TABLE[kind][name]
    assert unit.si(unit.of(value)) == pytest.approx(value, rel=1e-14, abs=1e-12)


def test_each_quantity_has_a_setting_whose_choices_are_the_table() -> None:
    fields = Units.model_fields
    assert {kind: get_args(field.annotation) for kind, field in fields.items()} == {
        kind: tuple(units) for kind, units in TABLE.items()
    }
    assert all(next(iter(units)) in UNITS for units in TABLE.values())
    assert all(field.default == next(iter(TABLE[kind])) for kind, field in fields.items())


def test_no_unit_is_of_two_quantities_whatever_its_capitals() -> None:
    names = [name.casefold() for _, name in ALL]
    assert len(names) == len(set(names))


def test_the_si_unit_is_left_as_it_is_bit_by_bit() -> None:
    values = np.random.default_rng(1).normal(size=100)
    for unit in sorted(UNITS):
        shown = Units().of(unit)
        assert shown.name == unit
        assert shown.of(values).tobytes() == values.tobytes()


def test_later_names_win_and_si_takes_all_back() -> None:
    units = Units(energy="kWh", angle="deg")
    assert units.but(["Wh"]) == Units(energy="Wh", angle="deg")
    assert units.but(["SI", "degf"]) == Units(temperature="degF")
    with pytest.raises(ValueError, match="no unit 'parsec': expected SI, or any of J, kJ"):
        units.but(["parsec"])
    with pytest.raises(ValueError, match="no unit 'MW'"):
        units.but(["MW"])
