"""Emulated ABB arms sending EGM at 250 Hz to one event loop, beside the ABBRobotEGM library with a thread a robot.

    python bench/drivers/abb.py

The arms run in a process of their own. Both sides decode every packet; the plain loop does nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Sequence
from functools import partial

import numpy as np
from ABBRobotEGM import EGM
from sides import Length, Result, Run, Still, accounts, driven, in_turns, main, measured, served

from cellwatt_drivers.abb import AbbDriver, AbbSettings
from cellwatt_drivers.abb.emulator import AbbEmulator

ROBOTS, RATE = 8, 250.0


def devices(*ports: str) -> list[AbbEmulator]:
    return [AbbEmulator(Still(), "127.0.0.1:0", options={"egm": f"127.0.0.1:{port}"}) for port in ports]


def free_ports() -> list[int]:
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(ROBOTS)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in probes]


async def ours(ports: Sequence[int], seconds: float) -> Run:
    made = [AbbSettings(host="127.0.0.1", bind="127.0.0.1", egm_port=port, web=()) for port in ports]
    async with driven([partial(AbbDriver, f"arm_{s.egm_port}", s) for s in made]) as inlets:
        return await measured(accounts(inlets), seconds)


async def plain(ports: Sequence[int], seconds: float) -> Run:
    counts, going = np.zeros((len(ports), 2), dtype=int), threading.Event()
    going.set()

    def read(row: int, port: int) -> None:
        client, last = EGM(port=port), None
        while going.is_set():
            good, state = client.receive_from_robot(0.5)
            if good:
                counts[row] += 1, 0 if last is None else state.header.seqno - last - 1
                last = state.header.seqno
        client.socket.close()

    threads = [threading.Thread(target=read, args=each) for each in enumerate(ports)]
    for thread in threads:
        thread.start()
    run = await measured(lambda: (int(counts[:, 0].sum()), int(counts[:, 1].sum())), seconds)
    going.clear()
    for thread in threads:
        await asyncio.to_thread(thread.join)
    return run


async def bench(length: Length) -> Result:
    """Both sides in turns, at the same robots."""
    ports = free_ports()
    async with served(__file__, *map(str, ports)):
        both = await in_turns(partial(ours, ports), partial(plain, ports), length)
    return Result(ROBOTS, RATE, length.seconds, length.repeats, "ABBRobotEGM", *both)


if __name__ == "__main__":
    main(bench, devices)
