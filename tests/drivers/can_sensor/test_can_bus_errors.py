from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.can_sensor.bus_errors import decode_error


# Constants of linux/can/error.h.
@pytest.mark.parametrize(
    ("identifier", "data", "names", "state", "overflow"),
    [
        (0x040, "0000000000000000", ("bus off",), "off", False),
        (0x100, "0000000000000000", ("restarted",), "active", False),
        (0x004, "0004000000000000", ("controller",), "warning", False),
        (0x004, "0020000000000000", ("controller",), "passive", False),
        (0x004, "0040000000000000", ("controller",), "active", False),
        (0x004, "0001000000000000", ("controller",), None, True),
        (0x088, "0000021900000000", ("protocol", "bus error"), None, False),
        (0x020, "0000000000000000", ("no acknowledgement",), None, False),
        (0x000, "", ("unknown",), None, False),
    ],
)
def test_error_frames(identifier, data, names, state, overflow):
    found = decode_error(identifier, bytes.fromhex(data))
    assert (found.names, found.state, found.overflow) == (names, state, overflow)


@given(st.integers(0, 2**29 - 1), st.binary(max_size=8))
def test_any_error_frame_has_a_name(identifier, data):
    assert decode_error(identifier, data).names
