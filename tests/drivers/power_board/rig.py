"""A driver, an emulator on the same loop with a real pty between them, and an inlet that keeps everything."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cellwatt import Account, Identity, Reading, SourceError, Stream
from cellwatt_drivers.power_board import PowerBoardDriver, PowerBoardSettings
from cellwatt_drivers.power_board.emulator import PowerBoardEmulator
from tests.drivers.power_board.samples import Slope
from tests.patience import eventually


@dataclass
class Inlet:
    """Keeps what it is given; the account must add up at every reading, and device time must rise."""

    account: Account = field(default_factory=Account)
    readings: list[Reading] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    resets: list[str] = field(default_factory=list)
    identities: list[Identity] = field(default_factory=list)
    clock: Callable[[], int] = time.time_ns
    _last: dict[str, int] = field(default_factory=dict)

    def now(self) -> int:
        return self.clock()

    def connected(self, identity: Identity) -> None:
        self.identities.append(identity)

    def emit(self, reading: Reading) -> None:
        self.account.receive(len(reading.values))
        assert self.account.residue == 0
        assert reading.device_time is not None
        times = [self._last.get(reading.stream.name, -(2**63)), *reading.device_time.tolist()]
        assert all(a < b for a, b in pairwise(times)), "device time must rise"
        self._last[reading.stream.name] = times[-1]
        self.readings.append(reading)

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a board is never asked anything")

    def clock_reset(self, stream: Stream, reason: str) -> None:
        self.resets.append(reason)
        self._last.pop(stream.name, None)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.events.append(text)

    def values(self, channel: str) -> np.ndarray:
        """All values of a channel, in the order in which they were given."""
        return np.concatenate([r.values[:, r.stream.names.index(channel)] for r in self.readings])

    def device_time(self) -> np.ndarray:
        """All device times, ns."""
        return np.concatenate([r.device_time for r in self.readings])


@asynccontextmanager
async def emulated(**options: str) -> AsyncIterator[tuple[PowerBoardEmulator, str]]:
    """An emulator that serves, and its port."""
    emulator = PowerBoardEmulator(Slope(), "pty", seed=3, options=options)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    async with running(emulator.serve(ready.set_result)) as serving:
        await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
        yield emulator, ready.result()


@asynccontextmanager
async def running(coroutine) -> AsyncIterator[asyncio.Task]:
    """A task that is ended at the end; an error of its own comes out there."""
    task = asyncio.create_task(coroutine)
    try:
        yield task
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@dataclass
class Supervised:
    """A driver that is run again whenever it fails, as the daemon does, without the pauses."""

    driver: PowerBoardDriver
    inlet: Inlet
    errors: list[str] = field(default_factory=list)

    async def run(self) -> None:
        while True:
            try:
                await self.driver.run()
            except SourceError as error:
                self.errors.append(str(error))
                await asyncio.sleep(0.02)


@asynccontextmanager
async def cell(settings: dict | None = None, **options: str):
    """Emulator, supervised driver and inlet, all going: yields (emulator, supervised)."""
    async with emulated(**options) as (emulator, port):
        given = {"port": port, "rate": "123 Hz", "reorder": "5 s"} | (settings or {})
        given.setdefault("mode", options.get("mode", "api"))
        given.setdefault("phases", int(options.get("phases", "3")))
        inlet = Inlet()
        supervised = Supervised(PowerBoardDriver("board", PowerBoardSettings(**given), inlet), inlet)
        async with running(supervised.run()):
            yield emulator, supervised


async def settled(emulator: PowerBoardEmulator, inlet: Inlet, samples: int) -> dict[str, int]:
    """Wait until the driver has accounted for everything made, at least ``samples``; the emulator's counts then."""

    def even() -> bool:
        return inlet.account.expected == emulator.counts["made"] >= samples

    await eventually(even)
    return dict(emulator.counts)
