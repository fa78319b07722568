"""A driver in this process and an emulated robot in another."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager

from cellwatt_drivers.franka.driver import FrankaDriver, FrankaSettings
from cellwatt_drivers.franka.emulator import FrankaEmulator

from ..inlet import CollectingInlet
from ..running import Steady, once, served

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0, -0.5)
PORT = 1337  # the library has no other; each test takes a loopback address of its own


STILL = Steady(
    {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
    | {f"joint_{i}.velocity": 0.125 * i for i in range(1, 8)}
    | {f"joint_{i}.torque": -3.25 * i for i in range(1, 8)}
    | {f"joint_{i}.torque_rate": 0.625 * i for i in range(1, 8)}
    | {"tool.x": 0.5, "tool.z": 0.25}
)


@asynccontextmanager
async def emulated(address: str, **options: str) -> AsyncIterator[FrankaEmulator]:
    emulator = FrankaEmulator(STILL, f"{address}:{PORT}", seed=1, options=options)
    async with served(emulator) as place:
        assert place == f"{address}:{PORT}"
        yield emulator


def driver(address: str, inlet: CollectingInlet, **changes: object) -> FrankaDriver:
    return FrankaDriver("arm", FrankaSettings.model_validate({"host": address} | changes), inlet)


def running(address: str, **changes: object) -> AbstractAsyncContextManager[tuple[CollectingInlet, asyncio.Task[None]]]:
    return once(driver(address, CollectingInlet(), **changes))
