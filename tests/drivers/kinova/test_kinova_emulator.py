"""The emulator read by pymodbus itself, and the driver against pymodbus' own server."""

from __future__ import annotations

import asyncio

import pytest

from cellwatt_drivers.kinova import registers
from tests.daemon.outlets.zenoh.processes import free_port
from tests.patience import eventually

from .rig import emulated, running

pymodbus = pytest.importorskip("pymodbus", reason="pymodbus is not installed")


async def test_pymodbus_reads_the_emulator():
    from pymodbus.client import AsyncModbusTcpClient

    async with emulated() as (emulator, port):
        client = AsyncModbusTcpClient("127.0.0.1", port=port)
        assert await client.connect()
        try:
            supply = await client.read_input_registers(6, count=4)
            decoded = client.convert_from_registers(supply.registers, client.DATATYPE.FLOAT32, word_order="little")
            assert decoded == [1.25, 24.0]
            gap = await client.read_input_registers(13, count=2)
            assert gap.exception_code == 2
            coil = await client.write_coil(0, True)
            assert coil.exception_code == 1
            held = await client.read_holding_registers(0, count=1)
            assert held.exception_code == 1
        finally:
            client.close()
    assert emulator.counts["written"] == 2


async def test_the_driver_reads_a_server_of_pymodbus():
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    arm = [1 << 7, 0, 0, 0, 0, 0, *registers.encode([1.25, 24.0, 45.0, 38.0])]
    motion = registers.encode([float(i) for i in range(53)])
    device = SimDevice(
        1,
        simdata=(
            [SimData(0, datatype=DataType.BITS, values=[0])],
            [SimData(0, datatype=DataType.BITS, values=[0])],
            [SimData(0, datatype=DataType.REGISTERS, values=[0])],
            [
                SimData(0, datatype=DataType.REGISTERS, values=arm),
                SimData(34, datatype=DataType.REGISTERS, values=motion),
            ],
        ),
    )
    port = free_port()
    server = ModbusTcpServer(device, address=("127.0.0.1", port))
    serving = asyncio.create_task(server.serve_forever())
    try:
        await eventually(server.is_active)
        async with running(port, read=["arm", "joints", "tool"]) as (inlet, _):
            await inlet.until(lambda o: len(o.of("motion")) > 3)
    finally:
        await server.shutdown()
        await asyncio.gather(serving, return_exceptions=True)
    assert inlet.of("arm")[0].values[0, :3].tolist() == [24.0, 1.25, 30.0]
    assert inlet.of("motion")[0].values[0, 14:21].tolist() == [14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0]
