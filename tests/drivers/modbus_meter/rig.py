"""Emulated meters and drivers on one loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import numpy as np

from cellwatt.errors import SourceError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver, ModbusMeterSettings
from cellwatt_drivers.modbus_meter.emulator import ModbusMeterEmulator

from ..outlet import CollectingOutlet


@dataclass
class Steady:
    """A load that stands still: 230 V, 2.5 A, 500 W."""

    def at(self, t):
        values = {"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0}
        return {name: np.full(len(t), value) for name, value in values.items()}

    def disturb(self, change):
        raise ValueError("nothing to disturb")


@asynccontextmanager
async def emulated(address: str = "127.0.0.1:0", **options: str) -> AsyncIterator[tuple[ModbusMeterEmulator, str]]:
    """An emulator and where it listens."""
    emulator = ModbusMeterEmulator(Steady(), address, seed=3, options=options)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        yield emulator, await ready
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving


def settings(place: str, **changes: object) -> ModbusMeterSettings:
    if place.startswith("/"):
        base: dict[str, object] = {"line": place, "parity": "none"}
    else:
        host, _, port = place.rpartition(":")
        base = {"host": host, "port": int(port)}
    if "map" not in changes:
        base["meter"] = "eastron_sdm630"
    return ModbusMeterSettings.model_validate(base | {"rate": "20 Hz"} | changes)


@dataclass
class Run:
    driver: ModbusMeterDriver
    outlet: CollectingOutlet
    failures: list[SourceError]


@asynccontextmanager
async def running(wanted: ModbusMeterSettings) -> AsyncIterator[Run]:
    """A driver that is run again when it fails, until the end of the context; the account must be even then."""
    outlet = CollectingOutlet()
    run = Run(ModbusMeterDriver("meter", wanted, outlet), outlet, [])

    async def supervise() -> None:
        while True:
            try:
                await run.driver.run()
            except SourceError as error:
                run.failures.append(error)
                outlet.event("failed", str(error))
            await asyncio.sleep(0.01)

    task = asyncio.create_task(supervise())
    try:
        yield run
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert outlet.account.residue == 0
