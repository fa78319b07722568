"""A driver and an emulator on one loop, and an inlet that keeps what it is given."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np

from cellwatt_drivers.yaskawa import YaskawaDriver, YaskawaSettings
from cellwatt_drivers.yaskawa.emulator import YaskawaEmulator

from ..inlet import PolledInlet as Inlet
from ..running import Steady, once, served

PULSES = (1000.0, -2000.0, 1500.0, 800.0, 500.0, 250.0)
RATED = (200.0, 100.0, 50.0, 40.0, 20.0, 10.0)


ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0)
TORQUES = (24.0, -45.0, 15.0, -1.2, 1.4, -0.1)
STILL = Steady(
    {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
    | {f"joint_{i}.torque": m for i, m in enumerate(TORQUES, 1)}
    | {"tool.x": 0.123456, "tool.y": -0.05, "tool.z": 0.789012, "tool.rx": np.pi, "tool.ry": -np.pi / 2}
)


@asynccontextmanager
async def emulated(**options: str) -> AsyncIterator[tuple[YaskawaEmulator, int]]:
    """An emulator that answers at once unless told otherwise, and its port."""
    options = {
        "answer_ms": "0",
        "pulses_per_degree": ",".join(map(str, PULSES)),
        "rated_torque": ",".join(map(str, RATED)),
    } | options
    emulator = YaskawaEmulator(STILL, "127.0.0.1:0", seed=1, options=options)
    async with served(emulator) as address:
        yield emulator, int(address.rpartition(":")[2])


def settings(port: int, **changes: object) -> YaskawaSettings:
    base: dict[str, object] = {"host": "127.0.0.1", "port": port, "pulses_per_degree": PULSES, "rated_torque": RATED}
    return YaskawaSettings.model_validate(base | changes)


@asynccontextmanager
async def running(settings: YaskawaSettings) -> AsyncIterator[tuple[YaskawaDriver, Inlet, asyncio.Task[None]]]:
    """A driver running until the end of the context; fails when it failed."""
    driver = YaskawaDriver("arm", settings, Inlet())
    async with once(driver) as (inlet, task):
        yield driver, inlet, task
