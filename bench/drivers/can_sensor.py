"""An emulated IVT-S at 1 kHz on two results over udp_multicast, beside python-can's Notifier with cantools.

    python bench/drivers/can_sensor.py

The sensor runs in a process of its own. Both sides receive and decode every frame; the plain loop takes them from
``can.AsyncBufferedReader``, decodes with cantools and does nothing else.
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

import can
import cantools
import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity
from cellwatt_drivers.can_sensor import CanSensorDriver, CanSensorSettings
from cellwatt_drivers.can_sensor.emulator import MULTICAST_GROUP, CanSensorEmulator
from cellwatt_drivers.can_sensor.sensor_map import load_decodings

RATE = 1000.0
STREAMS = ("current", "voltage_1")
PORT = 43977


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
    """What one side did: samples a second, frames lost by the sensor's own count, share of one core."""

    samples_per_second: Spread
    lost: int
    cpu_share: Spread


@dataclass(frozen=True)
class Result:
    """Both sides, in turns in one run."""

    streams: int
    rate: float
    seconds: float
    repeats: int
    cellwatt: Side
    python_can: Side


class Still:
    """Signals that cost the emulator next to nothing."""

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        return {"bus.voltage": np.full(len(t), 48.0), "bus.current": np.full(len(t), 2.5)}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


async def serve() -> None:
    """The sensor's process; ends with its standard input."""
    cycles = ",".join(f"{name}={1e3 / RATE:g}" for name in STREAMS)
    emulator = CanSensorEmulator(Still(), f"udp_multicast:{MULTICAST_GROUP}:{PORT}", options={"cycles": cycles})
    serving = asyncio.create_task(emulator.serve(lambda place: print(place, flush=True)))
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


@asynccontextmanager
async def sensor() -> AsyncIterator[None]:
    child = await asyncio.create_subprocess_exec(
        sys.executable, __file__, "--serve", stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        await child.stdout.readline()
        yield
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

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        return

    def clock_reset(self, stream: Stream, reason: str) -> None:
        print(reason, file=sys.stderr)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


@dataclass(frozen=True)
class Run:
    samples: int
    lost: int
    cpu_share: float


async def ours(seconds: float) -> Run:
    outlet = Outlet()
    settings = CanSensorSettings(
        sensor="ivt_s",
        interface="udp_multicast",
        channel=MULTICAST_GROUP,
        port=PORT,
        read=STREAMS,
        rates=dict.fromkeys(STREAMS, RATE),
    )
    task = asyncio.create_task(CanSensorDriver("battery", settings, outlet).run())
    await outlet.up.wait()
    run = await measured(lambda: (outlet.account.received, outlet.account.missed.total()), seconds)
    await ended(task)
    return run


async def plain(seconds: float) -> Run:
    made, _ = load_decodings("ivt_s", None)
    messages = {m.frame_id: m for m in cantools.database.load_file(made.dbc).messages}
    counters = {m.frame_id: next(s.name for s in m.signals if s.name.endswith("_Counter")) for m in messages.values()}
    counts, last = [0, 0], {}
    reader = can.AsyncBufferedReader()

    async def read() -> None:
        while True:
            frame = await reader.get_message()
            signals = messages[frame.arbitration_id].decode(frame.data, decode_choices=False)
            number = signals[counters[frame.arbitration_id]]
            counts[0] += 1
            counts[1] += (number - last.get(frame.arbitration_id, number - 1)) % 16 - 1
            last[frame.arbitration_id] = number

    bus = can.Bus(interface="udp_multicast", channel=MULTICAST_GROUP, port=PORT, hop_limit=0, ignore_config=True)
    notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
    task = asyncio.create_task(read())
    run = await measured(lambda: (counts[0], counts[1]), seconds)
    await ended(task)
    await asyncio.to_thread(notifier.stop)
    bus.shutdown()
    return run


async def ended(task: asyncio.Task[None]) -> None:
    """Cancel a side; raises what ended it before."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def measured(counted: Callable[[], tuple[int, int]], seconds: float) -> Run:
    """After one second to settle: samples, losses and the share of a core that this process took."""
    await asyncio.sleep(1.0)
    before, begin, cpu = counted(), time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    share = (time.process_time() - cpu) / (time.monotonic() - begin)
    after = counted()
    return Run(after[0] - before[0], after[1] - before[1], share)


def side(runs: list[Run], seconds: float) -> Side:
    return Side(
        Spread.of([r.samples / seconds for r in runs]),
        sum(r.lost for r in runs),
        Spread.of([r.cpu_share for r in runs]),
    )


async def bench(seconds: float = 5.0, repeats: int = 3) -> Result:
    """Both sides in turns on the same bus."""
    sides: dict[Callable[[float], Awaitable[Run]], list[Run]] = {ours: [], plain: []}
    async with sensor():
        for _ in range(repeats):
            for contender, runs in sides.items():
                runs.append(await contender(seconds))
    return Result(len(STREAMS), RATE, seconds, repeats, side(sides[ours], seconds), side(sides[plain], seconds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve())
    else:
        print(json.dumps(asdict(asyncio.run(bench())), indent=2))
