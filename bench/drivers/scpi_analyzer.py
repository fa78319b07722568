"""16 emulated HMC8015 polled at 10 Hz from one event loop, beside asyncio's streams in a plain loop.

    python bench/drivers/scpi_analyzer.py

The analyzers run in a process of their own. Both sides ask ``CHAN1:MEAS:DATA?`` and make numbers of the answer; the
plain loop has one connection and one task an analyzer, and sleeps.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from functools import partial

from sides import Length, Result, Run, Still, accounts, driven, in_turns, main, measured, served

from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from cellwatt_drivers.scpi_analyzer.driver import ScpiAnalyzerSettings
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator

ANALYZERS, RATE = 16, 10.0


def devices() -> list[ScpiAnalyzerEmulator]:
    return [ScpiAnalyzerEmulator(Still(), "127.0.0.1:0", seed=seed) for seed in range(ANALYZERS)]


async def ours(ports: Sequence[int], seconds: float) -> Run:
    made = [ScpiAnalyzerSettings(host="127.0.0.1", port=port, rate=RATE) for port in ports]
    named = [partial(ScpiAnalyzerDriver, f"mains_{number}", settings) for number, settings in enumerate(made)]
    async with driven(named) as inlets:
        return await measured(accounts(inlets), seconds)


async def plain(ports: Sequence[int], seconds: float) -> Run:
    counts, going = [0, 0], asyncio.Event()
    going.set()

    async def poll(port: int, deadline: float) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while going.is_set():
            await asyncio.sleep(max(0.0, deadline - time.monotonic()))
            writer.write(b"CHAN1:MEAS:DATA?\n")
            [float(value) for value in (await reader.readline()).split(b",")]
            counts[0] += 1
            deadline += 1 / RATE
            while deadline < time.monotonic():
                counts[1] += 1
                deadline += 1 / RATE
        writer.close()
        await writer.wait_closed()

    start = time.monotonic() + 0.2
    tasks = [asyncio.create_task(poll(port, start + i / RATE / len(ports))) for i, port in enumerate(ports)]
    run = await measured(lambda: (counts[0], counts[1]), seconds)
    going.clear()
    await asyncio.gather(*tasks)
    return run


async def bench(length: Length) -> Result:
    """Both sides in turns against the same analyzers."""
    async with served(__file__) as addresses:
        ports = [int(address.rpartition(":")[2]) for address in addresses]
        both = await in_turns(partial(ours, ports), partial(plain, ports), length)
    return Result(ANALYZERS, RATE, length.seconds, length.repeats, "asyncio streams", *both)


if __name__ == "__main__":
    main(bench, devices)
