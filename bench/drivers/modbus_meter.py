"""32 emulated SDM630 meters on Modbus TCP at 5 Hz from one event loop, beside pymodbus's client in a plain loop.

    python bench/drivers/modbus_meter.py

The meters run in a process of their own. Both sides read the same 26 values (84 registers in two requests) of each
meter, every 200 ms; the plain loop reads with one client a meter, decodes with pymodbus, and sleeps.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from functools import partial

from pymodbus.client import AsyncModbusTcpClient
from sides import Length, Result, Run, Still, accounts, driven, in_turns, main, measured, served

from cellwatt_drivers.modbus_meter import ModbusMeterDriver, ModbusMeterSettings
from cellwatt_drivers.modbus_meter.emulator import ModbusMeterEmulator

METERS, RATE = 32, 5.0


def devices() -> list[ModbusMeterEmulator]:
    return [ModbusMeterEmulator(Still(), "127.0.0.1:0", seed=seed) for seed in range(METERS)]


async def ours(ports: Sequence[int], seconds: float) -> Run:
    made = [ModbusMeterSettings(meter="eastron_sdm630", host="127.0.0.1", port=port, rate=RATE) for port in ports]
    async with driven([partial(ModbusMeterDriver, f"meter_{s.port}", s) for s in made]) as inlets:
        return await measured(accounts(inlets), seconds)


async def plain(ports: Sequence[int], seconds: float) -> Run:
    counts = [0, 0]
    clients = [AsyncModbusTcpClient("127.0.0.1", port=port, retries=0) for port in ports]
    for client in clients:
        await client.connect()

    ended = asyncio.Event()  # cancelled while its answer comes, pymodbus's client forgets it on Python 3.11

    async def poll(client: AsyncModbusTcpClient, deadline: float) -> None:
        kind = client.DATATYPE.FLOAT32
        while not ended.is_set():
            await asyncio.sleep(max(0.0, deadline - time.monotonic()))
            for address, count in ((0, 36), (0x34, 24)):
                answer = await client.read_input_registers(address, count=count, device_id=1)
                client.convert_from_registers(answer.registers, kind)
            counts[0] += 1
            deadline += 1 / RATE
            while deadline < time.monotonic():
                counts[1] += 1
                deadline += 1 / RATE

    start = time.monotonic() + 0.2
    tasks = [asyncio.create_task(poll(c, start + i / RATE / len(ports))) for i, c in enumerate(clients)]
    run = await measured(lambda: (counts[0], counts[1]), seconds)
    ended.set()
    await asyncio.gather(*tasks)
    for client in clients:
        client.close()
    return run


async def bench(length: Length) -> Result:
    """Both sides in turns against the same meters."""
    async with served(__file__) as addresses:
        ports = [int(address.rpartition(":")[2]) for address in addresses]
        both = await in_turns(partial(ours, ports), partial(plain, ports), length)
    return Result(METERS, RATE, length.seconds, length.repeats, "pymodbus", *both)


if __name__ == "__main__":
    main(bench, devices)
