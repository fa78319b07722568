"""64 emulated Yaskawa controllers polled at 50 Hz from one event loop, beside a plain ``asyncio.sleep`` loop.

    python bench/hses.py --json

The emulators (YRC1000: 5 ± 1 ms an answer) run in a process of their own. Both sides ask position, then torque.
Lateness is the time from a slot's deadline to the moment its first request leaves.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.driver import Identity
from cellwatt_drivers.yaskawa import YaskawaDriver, YaskawaSettings, payload, wire
from cellwatt_drivers.yaskawa.emulator import YaskawaEmulator

RATE = 50.0
TIMEOUT = 0.05
POSITION, TORQUE = wire.Request(wire.POSITION), wire.Request(wire.TORQUE)


class Still:
    """Signals that cost the emulators next to nothing."""

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        return {f"joint_{i}.{what}": np.full(len(t), 0.1 * i) for i in range(1, 7) for what in ("position", "torque")}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


async def serve(count: int) -> None:
    """The emulators' process: tells its ports as JSON, ends with its standard input."""
    loop = asyncio.get_running_loop()
    ports: list[asyncio.Future[str]] = [loop.create_future() for _ in range(count)]
    tasks = []
    for seed, ready in enumerate(ports):
        emulator = YaskawaEmulator(Still(), "127.0.0.1:0", seed=seed, options={"model": "YRC1000"})
        tasks.append(asyncio.create_task(emulator.serve(ready.set_result)))
    print(json.dumps([int((await ready).rpartition(":")[2]) for ready in ports]), flush=True)
    await loop.run_in_executor(None, sys.stdin.read)
    for task in tasks:
        task.cancel()


@asynccontextmanager
async def emulators(count: int) -> AsyncIterator[list[int]]:
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
class Tally:
    """What one side did within the measured time: polls due and missed, lateness of slots, ns."""

    due: int = 0
    missed: int = 0
    late: list[int] = field(default_factory=list)
    cpu_share: float = 0.0

    def figures(self) -> dict[str, float]:
        p50, p99, p999 = np.percentile(self.late, [50, 99, 99.9]) * 1e-6
        return {
            "polls_due": self.due,
            "polls_missed": self.missed,
            "lateness_p50_ms": round(float(p50), 3),
            "lateness_p99_ms": round(float(p99), 3),
            "lateness_p999_ms": round(float(p999), 3),
            "cpu_share": round(self.cpu_share, 3),
        }


class BenchDriver(YaskawaDriver):
    """Tells its inlet the deadline of each slot."""

    async def _serve_slot(self, link, deadline):
        self.inlet.deadline = deadline
        await super()._serve_slot(link, deadline)


@dataclass
class BenchInlet:
    tally: Tally
    account: Account = field(default_factory=Account)
    deadline: int = 0
    measuring: bool = False
    up: asyncio.Event = field(default_factory=asyncio.Event)

    def now(self) -> int:
        return time.monotonic_ns()

    def connected(self, identity: Identity) -> None:
        self.up.set()

    def emit(self, reading: Reading) -> None:
        self.account.receive()
        if self.measuring and reading.stream.name == "position":
            self.tally.late.append(reading.asked - self.deadline)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        print(text, file=sys.stderr)


async def ours(ports: list[int], seconds: float) -> Tally:
    """The driver itself."""
    tally = Tally()
    inlets = [BenchInlet(tally) for _ in ports]
    tasks = []
    for port, inlet in zip(ports, inlets, strict=True):
        settings = YaskawaSettings(
            host="127.0.0.1", port=port, read=("position", "torque"), rate=RATE, pulses_per_degree=(1000.0,) * 6
        )
        tasks.append(asyncio.create_task(BenchDriver(f"arm_{port}", settings, inlet).run()))
    await asyncio.gather(*(inlet.up.wait() for inlet in inlets))
    await asyncio.sleep(1.0)
    before = [(o.account.expected, o.account.missed.total()) for o in inlets]
    for inlet in inlets:
        inlet.measuring = True
    tally.cpu_share = await measured(seconds)
    for inlet, (expected, missed) in zip(inlets, before, strict=True):
        tally.due += inlet.account.expected - expected
        tally.missed += inlet.account.missed.total() - missed
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return tally


class PlainClient(asyncio.DatagramProtocol):
    """The shortest client that matches answers by their number."""

    def __init__(self) -> None:
        self.number = 0
        self.waiting: asyncio.Future[bytes] | None = None

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, addr):
        answer = wire.decode_answer(data)
        if self.waiting is not None and not self.waiting.done() and answer.number == self.number:
            self.waiting.set_result(answer.data)

    async def ask(self, request: wire.Request) -> bytes:
        self.number = (self.number + 1) % 256
        self.waiting = asyncio.get_running_loop().create_future()
        self.transport.sendto(wire.encode_request(request, self.number))
        async with asyncio.timeout(TIMEOUT):
            return await self.waiting


async def plain(ports: list[int], seconds: float) -> Tally:
    """One task a controller that sleeps until its next deadline and skips those long past, as ours does; started
    spread over the period.
    """
    tally = Tally()
    period = round(1e9 / RATE)
    start = time.monotonic_ns() + 1_000_000_000
    measuring = False

    async def poll(client: PlainClient, deadline: int) -> None:
        while True:
            await asyncio.sleep((deadline - time.monotonic_ns()) * 1e-9)
            skipped = max(0, (time.monotonic_ns() - deadline) // period)
            deadline += skipped * period
            late = time.monotonic_ns() - deadline
            lost = 0
            for request, decode in ((POSITION, decode_position), (TORQUE, payload.decode_axes)):
                try:
                    decode(await client.ask(request))
                except TimeoutError:
                    lost += 1
            deadline += period
            if measuring:
                tally.late.append(late)
                tally.due += 2 * (1 + skipped)
                tally.missed += lost + 2 * skipped

    def decode_position(data: bytes) -> payload.Position:
        return payload.decode_position(data, payload.PULSE)

    loop = asyncio.get_running_loop()
    tasks, transports = [], []
    for i, port in enumerate(ports):
        transport, client = await loop.create_datagram_endpoint(PlainClient, remote_addr=("127.0.0.1", port))
        transports.append(transport)
        tasks.append(asyncio.create_task(poll(client, start + i * period // len(ports))))
    await asyncio.sleep(2.0)
    measuring = True
    tally.cpu_share = await measured(seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for transport in transports:
        transport.close()
    return tally


async def measured(seconds: float) -> float:
    """Let the loop run, and give the share of a core that this process took meanwhile."""
    begin, before = time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    return (time.process_time() - before) / (time.monotonic() - begin)


def spread(runs: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Median, least and greatest of each figure over the repeats."""
    return {
        name: {
            "median": float(np.median([run[name] for run in runs])),
            "min": min(run[name] for run in runs),
            "max": max(run[name] for run in runs),
        }
        for name in runs[0]
    }


async def bench(controllers: int, seconds: float, repeats: int) -> dict[str, object]:
    runs: dict[str, list[dict[str, float]]] = {"cellwatt": [], "plain_asyncio_sleep": []}
    async with emulators(controllers) as ports:
        for _ in range(repeats):
            runs["cellwatt"].append((await ours(ports, seconds)).figures())
            runs["plain_asyncio_sleep"].append((await plain(ports, seconds)).figures())
    return {
        "controllers": controllers,
        "rate_hz": RATE,
        "seconds": seconds,
        "repeats": repeats,
        **{name: spread(found) for name, found in runs.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--controllers", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=10.0, help="measured time of each run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--serve", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        asyncio.run(serve(options.serve))
        return
    result = asyncio.run(bench(options.controllers, options.seconds, options.repeats))
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for side in ("cellwatt", "plain_asyncio_sleep"):
        print(side)
        for name, found in result[side].items():
            print(f"  {name:18} {found['median']:10g}  ({found['min']:g} … {found['max']:g})")


if __name__ == "__main__":
    main()
