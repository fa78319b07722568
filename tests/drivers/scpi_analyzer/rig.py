"""A driver and an emulator on one loop, and an outlet that keeps what it is given."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

import numpy as np

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity
from cellwatt.errors import SourceError
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver, ScpiAnalyzerSettings
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator


@dataclass
class Outlet:
    """Keeps readings and events. The residue is checked at every one."""

    account: Account = field(default_factory=Account)
    readings: list[Reading] = field(default_factory=list)
    events: list[tuple[str, str]] = field(default_factory=list)
    identities: list[Identity] = field(default_factory=list)
    failures: list[SourceError] = field(default_factory=list)

    def now(self) -> int:
        return time.time_ns()

    def connected(self, identity: Identity) -> None:
        self.identities.append(identity)

    def emit(self, reading: Reading) -> None:
        self.account.receive(len(reading.values))
        assert self.account.residue == 0
        self.readings.append(reading)

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a polled device has no clock")

    def clock_reset(self, stream: Stream, reason: str) -> None:
        raise AssertionError("a polled device has no clock")

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.events.append((kind, text))

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.events]


@dataclass
class Steady:
    """A load that stands still: 230 V, 2.5 A, 500 W."""

    values: dict[str, float]

    def at(self, t):
        return {name: np.full(len(t), value) for name, value in self.values.items()}

    def disturb(self, change):
        raise ValueError("nothing to disturb")


STILL = Steady({"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0})


@asynccontextmanager
async def emulated(address: str = "127.0.0.1:0", **options: str) -> AsyncIterator[tuple[ScpiAnalyzerEmulator, str]]:
    """An emulator and where it listens."""
    emulator = ScpiAnalyzerEmulator(STILL, address, seed=1, options=options)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        yield emulator, await ready
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving


def settings(place: str, **changes: object) -> ScpiAnalyzerSettings:
    if place.startswith("/"):
        base: dict[str, object] = {"serial": place}
    else:
        host, _, port = place.rpartition(":")
        base = {"host": host, "port": int(port)}
    return ScpiAnalyzerSettings.model_validate(base | changes)


@asynccontextmanager
async def running(settings: ScpiAnalyzerSettings) -> AsyncIterator[tuple[ScpiAnalyzerDriver, Outlet]]:
    """A driver that is run again when it fails, until the end of the context; the account must be even then."""
    outlet = Outlet()
    driver = ScpiAnalyzerDriver("supply", settings, outlet)

    async def supervise() -> None:
        while True:
            try:
                await driver.run()
            except SourceError as error:
                outlet.failures.append(error)
            await asyncio.sleep(0.01)

    task = asyncio.create_task(supervise())
    try:
        yield driver, outlet
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert outlet.account.residue == 0
