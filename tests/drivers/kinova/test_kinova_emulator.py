"""The emulator read by pymodbus itself, and the driver against pymodbus' own server."""

from __future__ import annotations

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.simulator import DataType, SimData

from cellwatt_drivers.kinova import registers

from ..modbus_meter.rig import answering
from ..running import endpoint
from .rig import emulated, running


async def test_pymodbus_reads_the_emulator():
    async with emulated() as (emulator, place):
        client = AsyncModbusTcpClient(**endpoint(place))
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
    arm = [1 << 7, 0, 0, 0, 0, 0, *registers.encode([1.25, 24.0, 45.0, 38.0])]
    motion = registers.encode([float(i) for i in range(53)])
    held = (SimData(at, datatype=DataType.REGISTERS, values=words) for at, words in ((0, arm), (34, motion)))
    async with answering(*held) as place, running(place, read=["arm", "joints", "tool"]) as (inlet, _):
        await inlet.until(lambda o: len(o.of("motion")) > 3)
    assert inlet.of("arm")[0].values[0, :3].tolist() == [24.0, 1.25, 30.0]
    assert inlet.of("motion")[0].values[0, 14:21].tolist() == [14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0]
