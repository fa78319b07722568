"""pyModbusTCP, which we did not write: its client at the emulator, the driver and its client at its server."""

from __future__ import annotations

import asyncio

import pytest

from tests.patience import PATIENCE

from .rig import emulated

client = pytest.importorskip("pyModbusTCP.client", reason="pyModbusTCP is not installed")
server = pytest.importorskip("pyModbusTCP.server", reason="pyModbusTCP is not installed")
values = pytest.importorskip("pyModbusTCP.utils", reason="pyModbusTCP is not installed")


def floats_read(place: str, address: int, count: int, unit: int = 1, low_first: bool = False) -> list[float]:
    """As its examples read floats."""
    host, _, port = place.rpartition(":")
    opened = client.ModbusClient(host=host, port=int(port), unit_id=unit, timeout=PATIENCE, auto_close=True)
    words = opened.read_input_registers(address, 2 * count)
    assert words is not None, opened.last_error_as_txt
    return [values.decode_ieee(n) for n in values.word_list_to_long(words, big_endian=not low_first)]


@pytest.mark.parametrize(
    ("meter", "volts", "watts", "low_first"),
    [("eastron_sdm630", 0, 0x34, False), ("shelly_pro_3em", 1020, 1013, True)],
)
async def test_its_client_reads_the_emulator(meter, volts, watts, low_first):
    async with emulated(meter=meter) as (emulator, place):
        assert await asyncio.to_thread(floats_read, place, volts, 1, 1, low_first) == [230.0]
        assert await asyncio.to_thread(floats_read, place, watts, 1, 1, low_first) == [500.0]
        assert emulator.counts["sent"] == 2
