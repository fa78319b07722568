"""The emulator, without our driver: clients that we did not write."""

from __future__ import annotations

import pytest
from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusIOException

from tests.patience import PATIENCE

from .rig import emulated

FLOAT32 = AsyncModbusTcpClient.DATATYPE.FLOAT32


async def client_of(place: str, timeout: float = PATIENCE, **kinds):
    if place.startswith("/"):
        client = AsyncModbusSerialClient(place, baudrate=9600, timeout=timeout, retries=0)
    else:
        host, _, port = place.rpartition(":")
        client = AsyncModbusTcpClient(host, port=int(port), timeout=timeout, retries=0, **kinds)
    assert await client.connect()
    return client


@pytest.mark.parametrize(("address", "framing"), [("127.0.0.1:0", "tcp"), ("127.0.0.1:0", "rtu"), ("pty", "rtu")])
async def test_pymodbus_reads_volts_and_watts(address, framing):
    async with emulated(address, framing=framing) as (emulator, place):
        kinds = {"framer": FramerType.RTU} if framing == "rtu" and address != "pty" else {}
        client = await client_of(place, **kinds)
        volts = await client.read_input_registers(0, count=6, device_id=1)
        watts = await client.read_input_registers(0x34, count=2, device_id=1)
        client.close()
        assert client.convert_from_registers(volts.registers, FLOAT32) == [230.0] * 3
        assert client.convert_from_registers(watts.registers, FLOAT32) == 500.0
        assert emulator.counts["sent"] == 2


async def test_what_a_meter_refuses():
    async with emulated(strict="yes") as (_, place):
        client = await client_of(place)
        for ask, code in (
            (client.read_holding_registers(0, count=2, device_id=1), 1),
            (client.read_input_registers(0, count=61, device_id=1), 3),
            (client.read_input_registers(1, count=2, device_id=1), 2),
            (client.read_input_registers(0x22, count=20, device_id=1), 2),
            (client.read_input_registers(0x2000, count=2, device_id=1), 2),
            (client.write_registers(0, [1, 2], device_id=1), 1),
        ):
            answer = await ask
            assert answer.isError()
            assert answer.exception_code == code
        client.close()
        impatient = await client_of(place, timeout=0.3)
        with pytest.raises(ModbusIOException):  # another unit is not there: silence
            await impatient.read_input_registers(0, count=2, device_id=9)
        impatient.close()
