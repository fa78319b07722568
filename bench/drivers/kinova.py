"""Emulated Kinova arms polled at 40 Hz from one event loop, beside pymodbus's client in a plain loop.

    python bench/drivers/kinova.py

The arms run in a process of their own. Both sides read registers 0 to 13 and 34 to 103 of each arm 40 times a second
and decode them; the plain loop has one client and one task an arm, and sleeps.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from functools import partial

from pymodbus.client import AsyncModbusTcpClient
from sides import Length, Result, Run, Still, accounts, driven, in_turns, main, measured, served

from cellwatt_drivers.kinova import KinovaDriver, KinovaSettings
from cellwatt_drivers.kinova.emulator import KinovaEmulator

ARMS, RATE = 8, 40.0


def devices() -> list[KinovaEmulator]:
    return [KinovaEmulator(Still(), "127.0.0.1:0") for _ in range(ARMS)]


async def ours(ports: Sequence[int], seconds: float) -> Run:
    made = [KinovaSettings(host="127.0.0.1", port=port, rate=RATE) for port in ports]
    async with driven([partial(KinovaDriver, f"arm_{s.port}", s) for s in made]) as inlets:
        return await measured(accounts(inlets), seconds)


async def plain(ports: Sequence[int], seconds: float) -> Run:
    counts = [0, 0]
    ended = asyncio.Event()  # cancelled while its answer comes, pymodbus's client forgets it on Python 3.11

    async def poll(client: AsyncModbusTcpClient) -> None:
        deadline = time.monotonic()
        while not ended.is_set():
            for first, count in ((0, 14), (34, 70)):
                answer = await client.read_input_registers(first, count=count)
                start = 6 if first == 0 else 0
                client.convert_from_registers(answer.registers[start:], client.DATATYPE.FLOAT32, word_order="little")
                counts[0] += 1
            deadline += 1 / RATE
            late = max(0, int((time.monotonic() - deadline) * RATE))
            counts[1] += 2 * late
            deadline += late / RATE
            await asyncio.sleep(deadline - time.monotonic())

    clients = [AsyncModbusTcpClient("127.0.0.1", port=port) for port in ports]
    for client in clients:
        await client.connect()
    tasks = [asyncio.create_task(poll(client)) for client in clients]
    run = await measured(lambda: (counts[0], counts[1]), seconds)
    ended.set()
    await asyncio.gather(*tasks)
    for client in clients:
        client.close()
    return run


async def bench(length: Length) -> Result:
    """Both sides in turns, at the same arms."""
    async with served(__file__) as addresses:
        ports = [int(address.rpartition(":")[2]) for address in addresses]
        both = await in_turns(partial(ours, ports), partial(plain, ports), length)
    return Result(ARMS, RATE, length.seconds, length.repeats, "pymodbus", *both)


if __name__ == "__main__":
    main(bench, devices)
