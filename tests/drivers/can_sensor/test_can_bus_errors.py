from __future__ import annotations

import pytest

from cellwatt_drivers.can_sensor.bus_errors import decode_error


# Constants of linux/can/error.h.
@pytest.mark.parametrize(
    ("identifier", "data", "names", "state", "overflow"),
    [
        (0x040, "0000000000000000", ("bus off",), "off", False),
        (0x100, "0000000000000000", ("restarted",), "active", False),
        (0x004, "0004000000000000", ("controller",), "warning", False),
        (0x004, "0001000000000000", ("controller",), None, True),
        (0x088, "0000021900000000", ("protocol", "bus error"), None, False),
        (0x000, "", ("unknown",), None, False),
    ],
)
def test_error_frames(identifier, data, names, state, overflow):
    found = decode_error(identifier, bytes.fromhex(data))
    assert (found.names, found.state, found.overflow) == (names, state, overflow)
