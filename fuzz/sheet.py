"""Tables from a grammar of what spreadsheets, loggers and locales write: each is read as it was meant."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cellwatt.emulation.signals import load_signals
from cellwatt.errors import RecordingError
from cellwatt.tables import read_table
from fuzz.sheets import drawn
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """The values are those that were written, a word of no number is refused by its cell, and commands agree."""
    sheet = drawn(data)
    path = folder() / "sheet.csv"
    path.write_bytes(sheet.content)
    table = read_table(path)
    np.testing.assert_allclose(table.rising_time(), sheet.time, rtol=0, atol=1e-6)
    signals = load_signals(path)
    assert set(signals.columns) == set(table.columns) - {table.clock}
    for i, truth in enumerate(sheet.position):
        try:
            found = table.channel(f"joint_{i + 1}.position")
        except RecordingError as error:
            assert i == sheet.odd_joint and sheet.odd is not None, error
            word, row, column = sheet.odd
            assert f"first {word!r} in row {row}, column {column}" in str(error), (str(error), sheet.odd)
            continue
        assert i != sheet.odd_joint, sheet.odd
        np.testing.assert_allclose(found, truth, rtol=1e-12)


def seeds() -> Iterable[bytes]:
    """Every locale, and every byte once."""
    yield from (bytes([i]) + bytes(range(64)) for i in range(9))
    yield bytes(range(256))


TARGET = Target(run, seeds, 256)
