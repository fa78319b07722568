"""A driver and an emulated controller on one loop."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import numpy as np

from cellwatt_drivers.abb import AbbDriver, AbbSettings
from cellwatt_drivers.abb.emulator import AbbEmulator

from ..outlet import CollectingOutlet

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0)


class Steady:
    """Signals that stand still: 200 W in all, 10 Nm at 0.5 rad/s on joint 2."""

    def at(self, t):
        values = {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
        values |= {"supply.power": 200.0, "joint_2.torque": 10.0, "joint_2.velocity": 0.5}
        values |= {"tool.x": 0.5, "tool.z": 0.8125, "tool.force_x": 1.5, "tool.torque_z": -0.25}
        return {name: np.full(len(t), value) for name, value in values.items()}

    def disturb(self, change):
        raise ValueError("nothing to disturb")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@asynccontextmanager
async def emulated(**options: str) -> AsyncIterator[tuple[AbbEmulator, dict[str, object]]]:
    """An emulator, and the settings that reach it."""
    port = free_port()
    emulator = AbbEmulator(Steady(), "127.0.0.1:0", seed=1, options={"egm": f"127.0.0.1:{port}"} | options)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        web = int((await ready).rpartition(":")[2])
        yield emulator, {"host": "127.0.0.1", "port": web, "egm_port": port, "bind": "127.0.0.1", "tls": False}
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving


@asynccontextmanager
async def running(settings: dict[str, object]) -> AsyncIterator[tuple[CollectingOutlet, asyncio.Task[None]]]:
    """A driver running until the end of the context; fails when it failed."""
    outlet = CollectingOutlet()
    task = asyncio.create_task(AbbDriver("arm", AbbSettings.model_validate(settings), outlet).run())
    try:
        yield outlet, task
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    assert outlet.account.residue == 0


def of(outlet: CollectingOutlet, stream: str) -> list:
    return [r for r in outlet.readings if r.stream.name == stream]
