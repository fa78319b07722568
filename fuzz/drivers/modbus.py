"""A meter's registers and counters."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import get_args

import numpy as np

from cellwatt_drivers.modbus_meter.counter import RisingCounter
from cellwatt_drivers.modbus_meter.registers import RegisterType, Slot, plan
from fuzz.target import Target

KINDS = get_args(RegisterType)
SLOTS = tuple(Slot(8 * i + i % 3, kind, i) for i, kind in enumerate(KINDS))
BLOCKS = {order: plan(SLOTS, 125, 30, order) for order in ("big", "little")}


def run(data: bytes) -> None:
    """Registers as every type in both word orders, then as a counter's readings."""
    words = list(struct.unpack(f">{len(data) // 2}H", data[: len(data) // 2 * 2]))
    for order, blocks in BLOCKS.items():
        for block in blocks:
            registers = (words + [0] * block.count)[: block.count]
            numbers = block.decode(registers)
            assert len(numbers) == len(block.columns)
            again = [0] * block.count
            block.encode(numbers, again, block.address)
            # A NaN keeps its value, not always its bits.
            np.testing.assert_array_equal(block.decode(again), numbers, err_msg=order)
            for part in block.split():
                part.decode([0] * part.count)
    counter = RisingCounter(65536.0, 1.0)
    before = -1.0
    for second, word in enumerate(words):
        found = counter.take(float("nan") if word == 0xFFFF else float(word), float(second))
        value = found.value
        assert not value < before, found
        before = value if value == value else before


def seeds() -> Iterable[bytes]:
    """Numbers as a meter writes them, and a counter that wraps."""
    yield struct.pack(">hHiIqQfd", -1, 2, -3, 4, -5, 6, 230.5, 1e-9)
    yield struct.pack(">8H", 1, 5, 65000, 65400, 3, 65535, 9, 2)
    yield bytes(range(128))


TARGET = Target(run, seeds, 512)
