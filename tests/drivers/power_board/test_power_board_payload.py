"""The board's payload against the fact sheet's worked example and an independent CRC."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt import Quality
from cellwatt_drivers.power_board import payload
from tests.drivers.power_board.samples import EXAMPLE, EXAMPLE_BYTES, bitwise_crc, packets


def test_worked_example_both_ways() -> None:
    assert payload.parse(EXAMPLE_BYTES) == EXAMPLE
    assert payload.build(EXAMPLE) == EXAMPLE_BYTES


def test_worked_example_in_si() -> None:
    values, quality = payload.measured(EXAMPLE.raw, EXAMPLE.phases)
    assert values.tolist() == [[[230.12, 10.5, 2410.0], [229.87, 9.875, -50.0], [231.05, 0.0, 0.0]]]
    assert quality.tolist() == [Quality.GOOD]


def test_batch_is_62_bytes_for_two_samples_of_three_phases() -> None:
    batch = EXAMPLE._replace(step=8130, raw=EXAMPLE.raw * 2)
    data = payload.build(batch)
    assert len(data) == 62
    head = bytes.fromhex("02073412efcdab00 0203c21f")
    assert data == head + EXAMPLE_BYTES[8:-2] * 2 + struct.pack("<H", bitwise_crc(head + EXAMPLE_BYTES[8:-2] * 2))
    assert payload.parse(data) == batch
    assert batch.samples == 2


@settings(deadline=None)
@given(packets())
def test_round_trip(sent: payload.Packet) -> None:
    assert payload.parse(payload.build(sent)) == sent


@settings(deadline=None)
@given(packets(), st.data())
def test_any_burst_of_16_bits_is_refused(sent: payload.Packet, data: st.DataObject) -> None:
    """A CRC of 16 bits finds every error that lies within 16 neighbouring bits."""
    good = payload.build(sent)
    flip = data.draw(st.integers(1, 0xFFFF))
    at = data.draw(st.integers(0, len(good) * 8 - 16))
    bad = (int.from_bytes(good, "big") ^ flip << at).to_bytes(len(good), "big")
    assert payload.parse(bad) is None


def _sealed(body: bytes) -> bytes:
    return body + struct.pack("<H", bitwise_crc(body))


@pytest.mark.parametrize(
    ("what", "body"),
    [
        ("unknown version", b"\x03" + EXAMPLE_BYTES[1:-2]),
        ("no phase", EXAMPLE_BYTES[:8]),
        ("four phases", EXAMPLE_BYTES[:-2] + bytes(8)),
        ("batch of no sample", b"\x02" + EXAMPLE_BYTES[1:8] + b"\x00\x03\xc2\x1f" + bytes(8)),
        ("batch without a step", b"\x02" + EXAMPLE_BYTES[1:8] + b"\x01\x01\x00\x00" + bytes(8)),
        ("batch shorter than it says", b"\x02" + EXAMPLE_BYTES[1:8] + b"\x02\x01\xc2\x1f" + bytes(8)),
        ("batch longer than it says", b"\x02" + EXAMPLE_BYTES[1:8] + b"\x01\x01\xc2\x1f" + bytes(16)),
    ],
)
def test_wrong_form_with_a_right_crc_is_refused(what: str, body: bytes) -> None:
    assert payload.parse(_sealed(body)) is None, what


@pytest.mark.parametrize(
    ("position", "raw"), [(0, 0xFFFF), (1, 0xFFFF), (2, 0x7FFF_FFFF), (2, -0x8000_0000)], ids=["U", "I", "P", "-P"]
)
def test_end_of_range_is_marked_as_clipped(position: int, raw: int) -> None:
    first, second = [0] * 9, [0] * 9
    second[3 + position] = raw
    _, quality = payload.measured(first + second, 3)
    assert quality.tolist() == [Quality.GOOD, Quality.CLIPPED]


def test_emulated_values_saturate() -> None:
    wild = np.array([[[1000.0, 100.0, 1e9], [-5.0, -5.0, -1e9]]])
    assert payload.raw(wild) == (0xFFFF, 0xFFFF, 0x7FFF_FFFF, 0, 0, -0x8000_0000)
