"""An emulated Franka robot at 1 kHz, read by the driver, beside pylibfranka's ``read_once`` in a loop.

    python bench/drivers/franka.py

The robot runs in a process of its own, and so does the library on both sides; the driver's share of a core is that of
its process and of the daemon's together. How late a state is counts from the state that came quickest.
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
import psutil
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity
from cellwatt_drivers.franka import FrankaDriver, receive
from cellwatt_drivers.franka.driver import FrankaSettings
from cellwatt_drivers.franka.emulator import FrankaEmulator

ADDRESS, RATE = "127.0.43.1", 1000.0
PLAIN = """
import json, sys, time, pylibfranka
robot = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
end = time.monotonic() + 1.0
while time.monotonic() < end:
    robot.read_once()
stamps, late, cpu, begin = [], [], time.process_time(), time.monotonic()
while time.monotonic() < begin + float(sys.argv[2]):
    state = robot.read_once()
    values = state.q, state.dq, state.tau_J, state.theta, state.dtheta, state.tau_ext_hat_filtered, state.robot_mode
    stamps.append(state.time.to_sec())
    late.append(time.time() - stamps[-1])
share = (time.process_time() - cpu) / (time.monotonic() - begin)
print(json.dumps([[round(s * 1e3) for s in stamps], late, share]))
"""


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
    late: NDArray[np.float64]


@dataclass(frozen=True)
class Side:
    """What one side did: states a second, states lost by the robot's own time, share of one core, ms late."""

    samples_per_second: Spread
    lost: int
    cpu_share: Spread
    late_p50_ms: Spread
    late_p99_ms: Spread

    @classmethod
    def of(cls, runs: list[Run], seconds: float) -> Side:
        return cls(
            Spread.of([r.samples / seconds for r in runs]),
            sum(r.lost for r in runs),
            Spread.of([r.cpu_share for r in runs]),
            Spread.of([float(np.percentile(r.late - r.late.min(), 50)) * 1e3 for r in runs]),
            Spread.of([float(np.percentile(r.late - r.late.min(), 99)) * 1e3 for r in runs]),
        )


@dataclass(frozen=True)
class Result:
    """Both sides, in turns in one run."""

    robots: int
    rate: float
    seconds: float
    repeats: int
    cellwatt: Side
    pylibfranka: Side


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
    late: list[NDArray[np.float64]] = field(default_factory=list)

    def now(self) -> int:
        return time.time_ns()

    def connected(self, identity: Identity) -> None:
        self.up.set()

    def emit(self, reading: Reading) -> None:
        self.account.receive(len(reading.values))
        self.late.append((reading.arrival - reading.device_time) * 1e-9)

    def clock_reset(self, stream: Stream, reason: str) -> None:
        print(reason, file=sys.stderr)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


async def serve(*arguments: str) -> None:
    """The emulators' process: tells their ports as JSON, ends with its standard input."""
    loop = asyncio.get_running_loop()
    emulators = [FrankaEmulator(Still(), f"{ADDRESS}:1337", options={"realtime": "1"})]
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


async def ours(seconds: float) -> Run:
    outlet = Outlet()
    task = asyncio.create_task(FrankaDriver("arm", FrankaSettings(host=ADDRESS), outlet).run())
    await outlet.up.wait()
    await asyncio.sleep(1.0)
    us = [psutil.Process(), *(c for c in psutil.Process().children() if receive.__name__ in c.cmdline())]
    account = outlet.account
    outlet.late.clear()
    received, missed, begin, before = account.received, account.missed.total(), time.monotonic(), cpu(us)
    await asyncio.sleep(seconds)
    share = (cpu(us) - before) / (time.monotonic() - begin)
    run = Run(account.received - received, account.missed.total() - missed, share, np.concatenate(outlet.late))
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return run


def cpu(processes: list[psutil.Process]) -> float:
    return sum(sum(p.cpu_times()[:2]) for p in processes)


async def plain(seconds: float) -> Run:
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-c", PLAIN, ADDRESS, str(seconds), stdout=asyncio.subprocess.PIPE
    )
    out, _ = await child.communicate()
    stamps, late, share = json.loads(out)
    return Run(len(stamps), stamps[-1] - stamps[0] + 1 - len(stamps), share, np.array(late))


async def bench(seconds: float = 5.0, repeats: int = 3) -> Result:
    """Both sides in turns, at the same robot."""
    sides: dict[Callable[[float], Awaitable[Run]], list[Run]] = {ours: [], plain: []}
    async with served():
        for _ in range(repeats):
            for contender, runs in sides.items():
                runs.append(await contender(seconds))
                await asyncio.sleep(0.2)
    return Result(1, RATE, seconds, repeats, Side.of(sides[ours], seconds), Side.of(sides[plain], seconds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve(*sys.argv[2:]))
    else:
        print(json.dumps(asdict(asyncio.run(bench())), indent=2))
