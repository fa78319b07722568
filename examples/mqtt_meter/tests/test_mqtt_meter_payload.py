"""The meter's JSON, by an example of its maker's documentation."""

from __future__ import annotations

import math

import pytest
from mqtt_meter import payload

from cellwatt import ProtocolError

MESSAGE = b'{"id":0,"a_voltage":236.1,"total_current":11.116,"c_voltage":null,"total_act_power":2484.782}'


def test_fields_come_in_the_order_asked() -> None:
    assert payload.parse(MESSAGE, ["a_voltage", "total_act_power"]) == [236.1, 2484.782]


def test_null_and_absent_are_missing() -> None:
    assert all(math.isnan(v) for v in payload.parse(MESSAGE, ["c_voltage", "b_voltage", "total_current"])[:2])


@pytest.mark.parametrize(
    "message", [b"", b"\xff", b"[]", b"3", b'{"id": 0}', b'{"a_voltage": "x"}', b'{"a_voltage": true}']
)
def test_what_is_no_message(message: bytes) -> None:
    with pytest.raises(ProtocolError):
        payload.parse(message, ["a_voltage"])
