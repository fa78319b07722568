"""States that the library's process hands over, and FCI messages that the emulator reads."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from contextlib import suppress
from typing import get_args

import numpy as np

from cellwatt.channel import Stream
from cellwatt_drivers.franka import fci
from cellwatt_drivers.franka.fields import Group, Selection
from cellwatt_drivers.franka.intake import Intake
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target

SELECTION = Selection.of(["state"])
assert get_args(Group)


def run(data: bytes) -> None:
    """Rows of a time (i32 ms) and a mode (u8) in blocks, then as a connect message."""
    with suppress(struct.error):
        version, port = fci.decode_connect(data)
        assert struct.pack("<HH", version, port) == data[:4]
    stream = Stream("fci", SELECTION.channels, 1000.0, "device")
    intake = Intake(CheckingInlet(), stream, 1)
    whole = len(data) // 5 * 5
    rows = np.frombuffer(data[:whole], [("time", "<i4"), ("mode", "u1")])
    for start in range(0, len(rows), 7):
        block = rows[start : start + 7]
        values = np.zeros((len(block), len(SELECTION.channels)))
        values[:, 0] = np.where(block["mode"] == 255, np.nan, block["mode"])
        held = (block["mode"] % 16).astype(float)
        intake.take(block["time"].astype(np.int64), held, values)
        if start % 2:
            intake.opened()


def seeds() -> Iterable[bytes]:
    """Some states in a row with a gap, and a robot that starts anew."""
    times = [*range(1000, 1010), 1015, 1016, 2, 3, 4]
    yield b"".join(struct.pack("<iB", time, 1 + i % 3) for i, time in enumerate(times))
    yield struct.pack("<HH", fci.VERSION, 40000)


TARGET = Target(run, seeds, 512)
