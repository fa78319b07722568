"""Emulated Kinova arms polled at 40 Hz from one event loop, beside pymodbus's client in a plain loop.

    python bench/drivers/kinova.py

The arms run in a process of their own. Both sides read registers 0 to 13 and 34 to 103 of each arm 40 times a second
and decode them; the plain loop has one client and one task an arm, and sleeps.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import statistics
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray
from pymodbus.client import AsyncModbusTcpClient

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity
from cellwatt_drivers.kinova import KinovaDriver, KinovaSettings
from cellwatt_drivers.kinova.emulator import KinovaEmulator

ARMS, RATE = 8, 40.0


@dataclass(frozen=True)
class Spread:
    """Median, least and greatest over the repeats."""

    median: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, found: list[float]) -> Spread:
        return cls(round(statistics.median(found), 4), round(min(found), 4), round(max(found), 4))


@dataclass(frozen=True)
class Run:
    samples: int
    lost: int
    cpu_share: float


@dataclass(frozen=True)
class Side:
    """What one side did: answers a second of all arms, polls missed, share of one core."""

    samples_per_second: Spread
    lost: int
    cpu_share: Spread

    @classmethod
    def of(cls, runs: list[Run], seconds: float) -> Side:
        return cls(
            Spread.of([r.samples / seconds for r in runs]),
            sum(r.lost for r in runs),
            Spread.of([r.cpu_share for r in runs]),
        )


@dataclass(frozen=True)
class Result:
    """Both sides, in turns in one run."""

    arms: int
    rate: float
    seconds: float
    repeats: int
    cellwatt: Side
    pymodbus: Side


class Still:
    """Signals that cost the emulator next to nothing."""

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        return {f"joint_{i}.position": np.full(len(t), 0.1 * i) for i in range(1, 8)}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


@dataclass
class Outlet:
    account: Account = field(default_factory=Account)
    up: asyncio.Event = field(default_factory=asyncio.Event)

    def now(self) -> int:
        return time.time_ns()

    def connected(self, identity: Identity) -> None:
        self.up.set()

    def emit(self, reading: Reading) -> None:
        self.account.receive(len(reading.values))

    def clock_reset(self, stream: Stream, reason: str) -> None:
        print(reason, file=sys.stderr)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


async def serve(*arguments: str) -> None:
    """The emulators' process: tells their ports as JSON, ends with its standard input."""
    loop = asyncio.get_running_loop()
    emulators = [KinovaEmulator(Still(), "127.0.0.1:0") for _ in range(ARMS)]
    ready = [loop.create_future() for _ in emulators]
    tasks = [asyncio.create_task(e.serve(r.set_result)) for e, r in zip(emulators, ready, strict=True)]
    addresses = await asyncio.gather(*ready)
    print(json.dumps([int(address.rpartition(":")[2]) for address in addresses]), flush=True)
    await loop.run_in_executor(None, sys.stdin.read)
    for task in tasks:
        task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await asyncio.gather(*tasks)


@asynccontextmanager
async def served(*arguments: str) -> AsyncIterator[list[int]]:
    child = await asyncio.create_subprocess_exec(
        sys.executable, __file__, "--serve", *arguments, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        yield json.loads(await child.stdout.readline())
    finally:
        child.stdin.close()
        await child.wait()


async def ours(ports: list[int], seconds: float) -> Run:
    outlets, tasks = [Outlet() for _ in ports], []
    for port, outlet in zip(ports, outlets, strict=True):
        settings = KinovaSettings(host="127.0.0.1", port=port, rate=RATE)
        tasks.append(asyncio.create_task(KinovaDriver(f"arm_{port}", settings, outlet).run()))
    await asyncio.gather(*(outlet.up.wait() for outlet in outlets))
    run = await measured(
        lambda: (sum(o.account.received for o in outlets), sum(o.account.missed.total() for o in outlets)), seconds
    )
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return run


async def plain(ports: list[int], seconds: float) -> Run:
    counts = [0, 0]

    async def poll(client: AsyncModbusTcpClient) -> None:
        deadline = time.monotonic()
        while True:
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
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for client in clients:
        client.close()
    return run


async def measured(counted: Callable[[], tuple[int, int]], seconds: float) -> Run:
    """After one second to settle: samples, losses and the share of a core that this process took."""
    await asyncio.sleep(1.0)
    before, begin, cpu = counted(), time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    share = (time.process_time() - cpu) / (time.monotonic() - begin)
    after = counted()
    return Run(after[0] - before[0], after[1] - before[1], share)


async def bench(seconds: float = 5.0, repeats: int = 3) -> Result:
    """Both sides in turns, at the same arms."""
    sides: dict[Callable[[list[int], float], Awaitable[Run]], list[Run]] = {ours: [], plain: []}
    async with served() as ports:
        for _ in range(repeats):
            for contender, runs in sides.items():
                runs.append(await contender(ports, seconds))
    return Result(ARMS, RATE, seconds, repeats, Side.of(sides[ours], seconds), Side.of(sides[plain], seconds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve(*sys.argv[2:]))
    else:
        print(json.dumps(asdict(asyncio.run(bench())), indent=2))
