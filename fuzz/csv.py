"""CSV tables that people bring."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress

from cellwatt.emulation.signals import load_signals
from cellwatt.errors import RecordingError
from cellwatt.tables import read_table
from cellwatt_plugins.energy.recordings import read_reading
from fuzz.target import Target, folder

PLACE = re.compile(r"in row (\d+), column ([A-Z]+)")


def run(data: bytes) -> None:
    """As each command reads it."""
    path = folder() / "table.csv"
    path.write_bytes(data)
    with suppress(RecordingError):
        signals = load_signals(path)
        assert all(len(column) == len(signals.time) for column in signals.columns.values())
    with suppress(RecordingError):
        table = read_table(path)
        for reason in table.unfit.values():
            if (place := PLACE.search(reason)) is not None:  # the cell is there
                assert int(place[1]) <= 1 + len(re.findall(rb"\r\n|\r|\n", data.replace(b"\0", b"")))
                assert place[2] in table.letters.values()
        assert all(len(column) == len(table) for column in table.columns.values())
        table.joints("position")
    with suppress(RecordingError):
        read_reading(path)


def seeds() -> Iterable[bytes]:
    """Tables with each separator, text, times of day, quotes, and a meter's."""
    yield b"t,q_1,tau_1\n0.0,0.1,5\n0.1,0.2,\n0.2,nan,7\n"
    yield b"t;q 1;name\r\n0,0;0,1;a\r\n0,1;0,2;b\r\n"
    yield b"\xef\xbb\xbftimestamp  x\n 2026-01-01T00:00:00 1\n2026-01-01T00:00:01  2\n"
    yield b't,"a,b",a\n0,"1\n2",3\n'
    yield b"t,power,voltage,current\n" + b"".join(b"%d,%d,1,1\n" % (i, i % 7) for i in range(30))


TARGET = Target(run, seeds, 1024)
