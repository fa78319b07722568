"""Packets to test with: the worked example of the fact sheet, and any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from cellwatt_drivers.power_board.payload import Packet

EXAMPLE = Packet(
    board=7,
    sequence=0x1234,
    time=0x00ABCDEF,
    step=0,
    phases=3,
    raw=(23012, 10500, 241000, 22987, 9875, -5000, 23105, 0, 0),
)
EXAMPLE_BYTES = bytes.fromhex("01073412efcdab00 e459042968ad0300 cb59932678ecffff 415a000000000000 2291")
EXAMPLE_FRAME = bytes.fromhex(
    "7e002e900013a200404011221a2bc101073412efcdab00e459042968ad0300cb59932678ecffff415a00000000000022913d"
)
SENDER, NETWORK = 0x0013A20040401122, 0x1A2B


def bitwise_crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE by its definition: polynomial 0x1021, start 0xFFFF, nothing reflected."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def packet(number: int, *, board: int = 7, rate: float = 123.0, samples: int = 1, phases: int = 3, late: int = 0):
    """Packet ``number`` samples into the board's life, its clock ``late`` µs on."""
    raw = tuple((number * 7 + i) % 30000 for i in range(3 * phases * samples))
    time = round(number / rate * 1e6) + late
    step = round(1e6 / rate) if samples > 1 else 0
    return Packet(board, number % 2**16, time % 2**32, step, phases, raw)


@st.composite
def packets(draw: st.DrawFn) -> Packet:
    """Any packet that has a form on the wire and fits one radio packet."""
    phases = draw(st.integers(1, 3))
    samples = draw(st.integers(1, 30 // phases))
    step = draw(st.integers(1, 0xFFFF)) if samples > 1 else draw(st.integers(0, 0xFFFF))
    phase = st.tuples(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.integers(-(2**31), 2**31 - 1))
    raw = draw(st.lists(phase, min_size=samples * phases, max_size=samples * phases))
    return Packet(
        draw(st.integers(0, 255)),
        draw(st.integers(0, 0xFFFF)),
        draw(st.integers(0, 2**32 - 1)),
        step,
        phases,
        tuple(x for three in raw for x in three),
    )


@dataclass
class Slope:
    """Signals that tell the time: each sample's values name the moment at which it was made."""

    start: float = 100.0

    def at(self, t):
        power = self.start + 10.0 * np.asarray(t)
        return {"supply.power": power, "supply.voltage": np.full_like(power, 230.0), "supply.current": power / 230.0}

    def disturb(self, change):
        raise ValueError(f"a slope cannot be disturbed ({change})")
