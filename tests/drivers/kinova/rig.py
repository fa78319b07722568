"""A driver and an emulated arm on one loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager

from cellwatt_drivers.kinova import KinovaDriver, KinovaSettings
from cellwatt_drivers.kinova.emulator import KinovaEmulator

from ..inlet import CollectingInlet
from ..running import Steady, once, served

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0, -3.0)
STILL = (
    {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
    | {f"joint_{i}.velocity": 0.1 * i for i in range(1, 8)}
    | {f"joint_{i}.torque": -3.25 * i for i in range(1, 8)}
    | {f"joint_{i}.current": 0.5 * i for i in range(1, 8)}
    | {f"joint_{i}.temperature": 30.0 + i for i in range(1, 8)}
    | {"bus.voltage": 24.0, "bus.current": 1.25, "tool.x": 0.5, "tool.rz": 1.5, "tool.torque_z": -0.75}
)


@asynccontextmanager
async def emulated(signals=None, **options: str) -> AsyncIterator[tuple[KinovaEmulator, int]]:
    """An emulator and its port."""
    emulator = KinovaEmulator(signals or Steady(STILL), "127.0.0.1:0", seed=1, options=options)
    async with served(emulator) as address:
        yield emulator, int(address.rpartition(":")[2])


def driver(port: int, inlet: CollectingInlet, **changes: object) -> KinovaDriver:
    settings = {"host": "127.0.0.1", "port": port, "timeout": "2 s"} | changes
    return KinovaDriver("arm", KinovaSettings.model_validate(settings), inlet)


def running(port: int, **changes: object) -> AbstractAsyncContextManager[tuple[CollectingInlet, asyncio.Task[None]]]:
    return once(driver(port, CollectingInlet(), **changes))
