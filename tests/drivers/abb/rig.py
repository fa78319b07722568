"""A driver and an emulated controller on one loop."""

from __future__ import annotations

import socket
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from cellwatt_drivers.abb import AbbDriver, AbbSettings
from cellwatt_drivers.abb.emulator import AbbEmulator

from ..inlet import CollectingInlet
from ..running import Steady, once, served

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0)


STILL = Steady(
    {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
    | {"supply.power": 200.0, "joint_2.torque": 10.0, "joint_2.velocity": 0.5}
    | {"tool.x": 0.5, "tool.z": 0.8125, "tool.force_x": 1.5, "tool.torque_z": -0.25}
)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@asynccontextmanager
async def emulated(**options: str) -> AsyncIterator[tuple[AbbEmulator, dict[str, object]]]:
    """An emulator, and the settings that reach it."""
    port = free_port()
    emulator = AbbEmulator(STILL, "127.0.0.1:0", seed=1, options={"egm": f"127.0.0.1:{port}"} | options)
    async with served(emulator) as address:
        web = int(address.rpartition(":")[2])
        yield emulator, {"host": "127.0.0.1", "port": web, "egm_port": port, "bind": "127.0.0.1", "tls": False}


def driver(place: dict[str, object], **changes: object) -> AbbDriver:
    return AbbDriver("arm", AbbSettings.model_validate(place | changes), CollectingInlet())


def running(place: dict[str, object], **changes: object) -> AbstractAsyncContextManager[tuple[CollectingInlet, Any]]:
    return once(driver(place, **changes))
