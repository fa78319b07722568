"""Blocks of an arm's input registers."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cellwatt_drivers.kinova import registers
from fuzz.target import Target


def run(data: bytes) -> None:
    """As many whole blocks as there are bytes, then the rest filled up with zeros."""
    turns = registers.Turns()
    for start in range(0, max(len(data), 1), 212):
        block = data[start : start + 212].ljust(212, b"\0")
        words = np.frombuffer(block, "<u2").tolist()
        assert len(registers.arm_values(words[:14])) == len(registers.ARM_CHANNELS)
        read = registers.joints(40.0, 6, tool=True)
        values = registers.motion_values(words, 6)
        assert len(values) == len(read.stream.channels)
        assert len(registers.motion_values(words[:70], 7)) == 35
        turns.unwrap(values[:6])
        floats = np.frombuffer(block, "<f4")
        assert np.array_equal(np.array(registers.encode(floats.tolist()), "<u2").view("<f4"), floats, equal_nan=True)


def seeds() -> Iterable[bytes]:
    """An arm's block and a motion block."""
    arm = [1 << 7, 0, 0, 0, 0, 0, *registers.encode([1.5, 24.0, 40.0, 30.0])]
    yield np.array(arm, "<u2").tobytes()
    yield np.array(registers.encode([179.0] * 53), "<u2").tobytes() * 2


TARGET = Target(run, seeds, 636)
