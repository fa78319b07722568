"""Maps, browse paths, units and settings."""

from __future__ import annotations

import pytest

from cellwatt.errors import ConfigError
from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from cellwatt_drivers.opc_ua.browse_path import Child, Step, chosen, parsed
from cellwatt_drivers.opc_ua.tag_map import packaged_map, unit_named

from ..inlet import CollectingInlet

GOOD = {"host": "192.0.2.1", "tags": {"supply.power": {"node": "ns=3;s=P", "unit": "kW"}}}


def make(**changes):
    return OpcUaDriver("plc", OpcUaSettings.model_validate(GOOD | changes), CollectingInlet())


def test_a_path_is_split_where_no_ampersand_stands():
    assert parsed("/Objects/di:DeviceSet/*/2:a&/b/*3/x y") == (
        Step("DeviceSet", "di"),
        Step("", any=True),
        Step("a/b", "2"),
        Step("", any=True, nth=3),
        Step("x y"),
    )


@pytest.mark.parametrize("path", ["", "/", "a//b", "a/"])
def test_an_empty_step_is_refused(path):
    with pytest.raises(ValueError, match="empty"):
        parsed(path)


def test_axes_are_taken_in_the_order_of_their_numbers():
    children = [Child(f"Axis_{n}", 3, f"i={n}", True) for n in (10, 2, 1)] + [Child("A", 3, "i=0", False)]
    assert [c.name for c in chosen(Step("", any=True), children, None)] == ["Axis_1", "Axis_2", "Axis_10"]
    assert [c.name for c in chosen(Step("", any=True, nth=3), children, None)] == ["Axis_10"]
    assert not chosen(Step("", any=True, nth=4), children, None)
    assert not chosen(Step("Axis_1"), children, 2)


@pytest.mark.parametrize(
    ("number", "text", "unit"),
    [
        (17476, "?", "deg"),
        (4408652, "", "degC"),
        (-1, "°C", "degC"),
        (-1, "furlong", None),
    ],
)
def test_the_servers_units_are_known_by_number_or_text(number, text, unit):
    """17476 and 4408652 are degree (DD) and degree Celsius (CEL) in the table of OPC 10000-8."""
    assert unit_named(number, text) == unit


def test_the_packaged_map_is_that_of_the_standard():
    made = packaged_map("opc_40010")
    assert made.namespaces == {
        "di": "http://opcfoundation.org/UA/DI/",
        "rob": "http://opcfoundation.org/UA/Robotics/",
    }
    names = [str(s) for s in made.values["joint_3.position"].steps]
    assert names[-5:] == ["*", "rob:Axes", "*3", "di:ParameterSet", "rob:ActualPosition"]
    assert not made.values["joint_1.position"].optional and made.values["joint_1.velocity"].optional


def test_tags_are_read_beside_a_map_and_in_the_order_of_read():
    made = make(model="opc_40010", read=["supply.power", "joint_2.position"])
    assert made.streams[0].names == ("supply.power", "joint_2.position")
    with pytest.raises(ConfigError, match=r"read: the map has no joint_7\.position; did you mean"):
        make(model="opc_40010", read=["joint_7.position"])


def test_a_map_of_ones_own_is_told_with_line_and_column(tmp_path):
    file = tmp_path / "plc.yaml"
    file.write_text("values:\n  a.x: {node: 'ns=3;s=P', unit: kWatt}\n")
    with pytest.raises(ConfigError, match=r"plc\.yaml:2:\d+: .*kWatt"):
        make(map=file)


def test_the_clock_allows_for_the_time_that_a_sample_waits_in_the_server():
    assert make(rate="10 Hz", publish="200 ms").least_delay == pytest.approx((0.0, 0.105))
    assert make(rate="1 Hz", publish="50 ms").least_delay == pytest.approx((0.0, 0.055))
