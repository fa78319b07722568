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
from cellwatt_drivers.yaskawa import YaskawaDriver, YaskawaSettings
from cellwatt_drivers.yaskawa.emulator import YaskawaEmulator

PULSES = (1000.0, -2000.0, 1500.0, 800.0, 500.0, 250.0)
RATED = (200.0, 100.0, 50.0, 40.0, 20.0, 10.0)


@dataclass
class Outlet:
    """Keeps readings and events. The residue is checked at every one."""

    account: Account = field(default_factory=Account)
    readings: list[Reading] = field(default_factory=list)
    events: list[tuple[str, str]] = field(default_factory=list)
    identities: list[Identity] = field(default_factory=list)

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

    def of(self, stream: str) -> list[Reading]:
        return [r for r in self.readings if r.stream.name == stream]


@dataclass
class Steady:
    """Signals that stand still."""

    values: dict[str, float]

    def at(self, t):
        return {name: np.full(len(t), value) for name, value in self.values.items()}

    def disturb(self, change):
        raise ValueError("nothing to disturb")


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
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        yield emulator, int((await ready).rpartition(":")[2])
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving


def settings(port: int, **changes: object) -> YaskawaSettings:
    base: dict[str, object] = {"host": "127.0.0.1", "port": port, "pulses_per_degree": PULSES, "rated_torque": RATED}
    return YaskawaSettings.model_validate(base | changes)


@asynccontextmanager
async def running(settings: YaskawaSettings) -> AsyncIterator[tuple[YaskawaDriver, Outlet, asyncio.Task[None]]]:
    """A driver running until the end of the context; fails when it failed."""
    outlet = Outlet()
    driver = YaskawaDriver("arm", settings, outlet)
    task = asyncio.create_task(driver.run())
    try:
        yield driver, outlet, task
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert outlet.account.residue == 0
