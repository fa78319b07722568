"""pyModbusTCP, which we did not write: its client at the emulator, the driver and its client at its server."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from tests.patience import PATIENCE

from .rig import emulated, running, settings

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


@asynccontextmanager
async def serving(floats: dict[int, float]) -> AsyncIterator[str]:
    """Its server with these floats in its input registers, high word first; all other registers are 0."""
    bank = server.DataBank()
    for address, value in floats.items():
        bank.set_input_registers(address, values.long_list_to_word([values.encode_ieee(value)]))
    opened = server.ModbusServer(host="127.0.0.1", port=0, no_block=True, data_bank=bank)
    await asyncio.to_thread(opened.start)
    try:
        yield f"127.0.0.1:{opened._service.server_address[1]}"
    finally:
        await asyncio.to_thread(opened.stop)


SDM630 = {0x00: 230.1, 0x02: 229.4, 0x04: 231.2, 0x0C: 151.5, 0x34: 500.0, 0x46: 49.98, 0x48: 1234.5}


async def test_the_driver_reads_its_server():
    async with serving(SDM630) as place, running(settings(place)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 3)
    found = dict(zip(run.driver.streams[0].names, run.inlet.readings[-1].values[0], strict=True))
    assert not run.failures
    assert found["phase_1.voltage"] == pytest.approx(230.1)
    assert found["phase_1.power"] == pytest.approx(151.5)
    assert found["supply.power"] == 500.0
    assert found["supply.frequency"] == pytest.approx(49.98)
    assert found["supply.energy_imported"] == pytest.approx(1234.5 * 3.6e6)
