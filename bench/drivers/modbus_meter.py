"""32 emulated SDM630 meters on Modbus TCP at 5 Hz from one event loop, beside pymodbus's client in a plain loop.

    python bench/drivers/modbus_meter.py

The meters run in a process of their own. Both sides read the same 26 values (84 registers in two requests) of each
meter, every 200 ms; the plain loop reads with one client a meter, decodes with pymodbus, and sleeps.
"""

from __future__ import annotations

import asyncio
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
from cellwatt.driver import Identity
from cellwatt_drivers.modbus_meter import ModbusMeterDriver, ModbusMeterSettings
from cellwatt_drivers.modbus_meter.emulator import ModbusMeterEmulator

METERS, RATE, VALUES = 32, 5.0, 26


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
class Side:
    """What one side did: polls a second of all meters together, values a second, polls missed, share of one core."""

    polls_per_second: Spread
    values_per_second: Spread
    missed: int
    cpu_share: Spread


@dataclass(frozen=True)
class Result:
    """Both sides, in turns in one run."""

    meters: int
    rate: float
    seconds: float
    repeats: int
    cellwatt: Side
    pymodbus: Side


class Still:
    """Signals that cost the emulators next to nothing."""

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        return {"supply.voltage": np.full(len(t), 230.0), "supply.power": np.full(len(t), 500.0)}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


async def serve(count: int) -> None:
    """The meters' process: tells its ports as JSON, ends with its standard input."""
    loop = asyncio.get_running_loop()
    ports: list[asyncio.Future[str]] = [loop.create_future() for _ in range(count)]
    tasks = [
        asyncio.create_task(ModbusMeterEmulator(Still(), "127.0.0.1:0", seed=seed).serve(ready.set_result))
        for seed, ready in enumerate(ports)
    ]
    print(json.dumps([int((await ready).rpartition(":")[2]) for ready in ports]), flush=True)
    await loop.run_in_executor(None, sys.stdin.read)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@asynccontextmanager
async def meters(count: int) -> AsyncIterator[list[int]]:
    child = await asyncio.create_subprocess_exec(
        sys.executable, __file__, "--serve", str(count), stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        yield json.loads(await child.stdout.readline())
    finally:
        child.stdin.close()
        await child.wait()


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

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


@dataclass(frozen=True)
class Run:
    polls: int
    missed: int
    cpu_share: float


async def ours(ports: list[int], seconds: float) -> Run:
    outlets = [Outlet() for _ in ports]
    tasks = []
    for port, outlet in zip(ports, outlets, strict=True):
        settings = ModbusMeterSettings(meter="eastron_sdm630", host="127.0.0.1", port=port, rate=RATE)
        tasks.append(asyncio.create_task(ModbusMeterDriver(f"meter_{port}", settings, outlet).run()))
    await asyncio.gather(*(outlet.up.wait() for outlet in outlets))

    def counted() -> tuple[int, int]:
        return sum(o.account.received for o in outlets), sum(o.account.missed.total() for o in outlets)

    run = await measured(counted, seconds)
    for task in tasks:
        task.cancel()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    if broken := [o for o in outcomes if isinstance(o, Exception)]:
        raise ExceptionGroup("drivers ended", broken)
    return run


async def plain(ports: list[int], seconds: float) -> Run:
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
    await asyncio.gather(*tasks, return_exceptions=True)
    for client in clients:
        client.close()
    return run


async def measured(counted: Callable[[], tuple[int, int]], seconds: float) -> Run:
    """After one second to settle: polls, misses and the share of a core that this process took."""
    await asyncio.sleep(1.0)
    before, begin, cpu = counted(), time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    share = (time.process_time() - cpu) / (time.monotonic() - begin)
    after = counted()
    return Run(after[0] - before[0], after[1] - before[1], share)


def side(runs: list[Run], seconds: float) -> Side:
    rates = [r.polls / seconds for r in runs]
    return Side(
        Spread.of(rates),
        Spread.of([VALUES * r for r in rates]),
        sum(r.missed for r in runs),
        Spread.of([r.cpu_share for r in runs]),
    )


async def bench(count: int = METERS, seconds: float = 5.0, repeats: int = 3) -> Result:
    """Both sides in turns against the same meters."""
    sides: dict[Callable[[list[int], float], Awaitable[Run]], list[Run]] = {ours: [], plain: []}
    async with meters(count) as ports:
        for _ in range(repeats):
            for contender, runs in sides.items():
                runs.append(await contender(ports, seconds))
    return Result(count, RATE, seconds, repeats, side(sides[ours], seconds), side(sides[plain], seconds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve(int(sys.argv[2])))
    else:
        print(json.dumps(asdict(asyncio.run(bench())), indent=2))
