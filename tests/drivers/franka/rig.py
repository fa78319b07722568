"""A driver in this process and an emulated robot in another."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import numpy as np

from cellwatt_drivers.franka.driver import FrankaDriver, FrankaSettings
from cellwatt_drivers.franka.emulator import FrankaEmulator

from ..outlet import CollectingOutlet

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0, -0.5)
PORT = 1337  # the library has no other; each test takes a loopback address of its own


class Steady:
    """Signals that stand still."""

    def at(self, t):
        values = {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
        values |= {f"joint_{i}.velocity": 0.125 * i for i in range(1, 8)}
        values |= {f"joint_{i}.torque": -3.25 * i for i in range(1, 8)}
        values |= {f"joint_{i}.torque_rate": 0.625 * i for i in range(1, 8)}
        values |= {"tool.x": 0.5, "tool.z": 0.25}
        return {name: np.full(len(t), value) for name, value in values.items()}

    def disturb(self, change):
        raise ValueError("nothing to disturb")


@asynccontextmanager
async def emulated(address: str, **options: str) -> AsyncIterator[FrankaEmulator]:
    emulator = FrankaEmulator(Steady(), f"{address}:{PORT}", seed=1, options=options)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        assert await ready == f"{address}:{PORT}"
        yield emulator
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving


def driver(address: str, outlet: CollectingOutlet, **changes: object) -> FrankaDriver:
    return FrankaDriver("arm", FrankaSettings.model_validate({"host": address} | changes), outlet)


@asynccontextmanager
async def running(address: str, **changes: object) -> AsyncIterator[tuple[CollectingOutlet, asyncio.Task[None]]]:
    """A driver running until the end of the context; fails when it failed."""
    outlet = CollectingOutlet()
    task = asyncio.create_task(driver(address, outlet, **changes).run())
    try:
        yield outlet, task
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert outlet.account.residue == 0
