"""pyModbusTCP, which we did not write: its client at the emulator."""

from __future__ import annotations

import asyncio

import pytest

from tests.patience import PATIENCE

from .rig import emulated

client = pytest.importorskip("pyModbusTCP.client", reason="pyModbusTCP is not installed")
values = pytest.importorskip("pyModbusTCP.utils", reason="pyModbusTCP is not installed")


def float_read(place: str, address: int, low_first: bool) -> float:
    """As its examples read one."""
    host, _, port = place.rpartition(":")
    opened = client.ModbusClient(host=host, port=int(port), unit_id=1, timeout=PATIENCE, auto_close=True)
    words = opened.read_input_registers(address, 2)
    assert words is not None, opened.last_error_as_txt
    (number,) = values.word_list_to_long(words, big_endian=not low_first)
    return values.decode_ieee(number)


@pytest.mark.parametrize(
    ("meter", "volts", "watts", "low_first"),
    [("eastron_sdm630", 0, 0x34, False), ("shelly_pro_3em", 1020, 1013, True)],
)
async def test_its_client_reads_the_emulator(meter, volts, watts, low_first):
    async with emulated(meter=meter) as (emulator, place):
        assert await asyncio.to_thread(float_read, place, volts, low_first) == 230.0
        assert await asyncio.to_thread(float_read, place, watts, low_first) == 500.0
        assert emulator.counts["sent"] == 2
