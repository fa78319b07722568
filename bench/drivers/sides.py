"""What the benchmarks of drivers share: a driver and a plain library's loop in turns, at the same emulated devices."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import statistics
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity
from cellwatt.emulation import Emulator

Counted = Callable[[], tuple[int, int]]
"""Samples and losses so far."""


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
    late: NDArray[np.float64] | None = None
    """s from a device's time stamp, whose zero is unknown, to the reader."""


@dataclass(frozen=True)
class Late:
    """ms behind the quickest sample."""

    p50_ms: Spread
    p99_ms: Spread

    @classmethod
    def of(cls, runs: Sequence[NDArray[np.float64]]) -> Late:
        late = [run - run.min() for run in runs]
        return cls(*(Spread.of([1e3 * float(np.percentile(x, p)) for x in late]) for p in (50, 99)))


@dataclass(frozen=True)
class Side:
    """What one side did: samples a second of all devices, samples lost in all, share of one core."""

    samples_per_second: Spread
    lost: int
    cpu_share: Spread
    late: Late | None

    @classmethod
    def of(cls, runs: list[Run], seconds: float) -> Side:
        late = [run.late for run in runs if run.late is not None]
        return cls(
            Spread.of([r.samples / seconds for r in runs]),
            sum(r.lost for r in runs),
            Spread.of([r.cpu_share for r in runs]),
            Late.of(late) if late else None,
        )


@dataclass(frozen=True)
class Result:
    """Both sides, in turns in one run; ``rate`` is that of each device's messages, Hz."""

    devices: int
    rate: float
    seconds: float
    repeats: int
    library: str
    cellwatt: Side
    plain: Side


@dataclass(frozen=True)
class Length:
    """How long each side runs, s, and how often."""

    seconds: float
    repeats: int


class Still:
    """Signals that cost the emulator next to nothing."""

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        joints = {f"joint_{i}.position": np.full(len(t), 0.1 * i) for i in range(1, 8)}
        supply = {"supply.voltage": 230.0, "supply.power": 500.0, "bus.voltage": 48.0, "bus.current": 2.5}
        return joints | {name: np.full(len(t), value) for name, value in supply.items()}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


@dataclass
class Inlet:
    """Counts; says on standard error what a driver tells."""

    account: Account = field(default_factory=Account)
    up: asyncio.Event = field(default_factory=asyncio.Event)
    late: list[NDArray[np.float64]] = field(default_factory=list)

    def now(self) -> int:
        return time.time_ns()

    def connected(self, identity: Identity) -> None:
        self.up.set()

    def emit(self, reading: Reading) -> None:
        self.account.receive(len(reading.values))
        if reading.device_time is not None:
            self.late.append((reading.arrival - reading.device_time) * 1e-9)

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        return

    def clock_reset(self, stream: Stream, reason: str) -> None:
        print(reason, file=sys.stderr)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


async def serve(emulators: Sequence[Emulator]) -> None:
    """The devices' process: tells their addresses as JSON, ends with its standard input."""
    loop = asyncio.get_running_loop()
    ready = [loop.create_future() for _ in emulators]
    tasks = [asyncio.create_task(e.serve(r.set_result)) for e, r in zip(emulators, ready, strict=True)]
    print(json.dumps(await asyncio.gather(*ready)), flush=True)
    await loop.run_in_executor(None, sys.stdin.read)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@asynccontextmanager
async def served(file: str, *arguments: str) -> AsyncIterator[list[str]]:
    """A benchmark's own devices in a process of their own; their addresses."""
    child = await asyncio.create_subprocess_exec(
        sys.executable, file, "--serve", *arguments, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        yield json.loads(await child.stdout.readline())
    finally:
        child.stdin.close()
        await child.wait()


@asynccontextmanager
async def driven(make: Sequence[Callable[[Inlet], Driver]]) -> AsyncIterator[list[Inlet]]:
    """Drivers in this loop, all connected. Raises what ended one of them."""
    inlets = [Inlet() for _ in make]
    tasks = [asyncio.create_task(each(inlet).run()) for each, inlet in zip(make, inlets, strict=True)]
    up = asyncio.gather(*(inlet.up.wait() for inlet in inlets))
    try:
        await asyncio.wait([up, *tasks], return_when=asyncio.FIRST_COMPLETED)
        if not up.done():
            up.cancel()
            return  # what ended a driver is raised below
        yield inlets
    finally:
        await ended(tasks)


async def ended(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel tasks; raises what ended them before."""
    for task in tasks:
        task.cancel()
    for task in tasks:
        with contextlib.suppress(asyncio.CancelledError):
            await task


def accounts(inlets: Sequence[Inlet]) -> Counted:
    """What the drivers received and missed."""
    return lambda: (sum(o.account.received for o in inlets), sum(o.account.missed.total() for o in inlets))


async def measured(counted: Counted, seconds: float, cpu: Callable[[], float] = time.process_time) -> Run:
    """After one second to settle: samples, losses and the share of a core that was taken."""
    await asyncio.sleep(1.0)
    before, begin, taken = counted(), time.monotonic(), cpu()
    await asyncio.sleep(seconds)
    share = (cpu() - taken) / (time.monotonic() - begin)
    after = counted()
    return Run(after[0] - before[0], after[1] - before[1], share)


async def in_turns(
    ours: Callable[[float], Awaitable[Run]], plain: Callable[[float], Awaitable[Run]], length: Length
) -> tuple[Side, Side]:
    """Both sides one after the other, as often as asked."""
    runs: tuple[list[Run], list[Run]] = ([], [])
    for _ in range(length.repeats):
        for side, found in zip((ours, plain), runs, strict=True):
            found.append(await side(length.seconds))
            await asyncio.sleep(0.2)
    return Side.of(runs[0], length.seconds), Side.of(runs[1], length.seconds)


def main(bench: Callable[[Length], Awaitable[Result]], devices: Callable[..., Sequence[Emulator]]) -> None:
    """Command line of a benchmark: prints its result as JSON; with --serve it is the devices' process."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--seconds", type=float, default=5.0, help="measured time of each run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--serve", nargs="*", help=argparse.SUPPRESS)
    given = parser.parse_args()

    async def run() -> Result | None:
        if given.serve is not None:
            await serve(devices(*given.serve))
            return None
        return await bench(Length(given.seconds, given.repeats))

    result = asyncio.run(run())
    if result is not None:
        print(json.dumps(asdict(result), indent=None if given.json else 2))
