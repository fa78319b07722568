"""A driver and an emulated arm on one loop."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from typing import Any

from cellwatt_drivers.kinova import KinovaDriver, KinovaSettings
from cellwatt_drivers.kinova.emulator import KinovaEmulator

from ..inlet import CollectingInlet
from ..running import Served, Steady, endpoint, once, with_address

ANGLES = (0.5, -0.25, 1.0, -1.5, 0.75, 2.0, -3.0)
STILL = (
    {f"joint_{i}.position": q for i, q in enumerate(ANGLES, 1)}
    | {f"joint_{i}.velocity": 0.1 * i for i in range(1, 8)}
    | {f"joint_{i}.torque": -3.25 * i for i in range(1, 8)}
    | {f"joint_{i}.current": 0.5 * i for i in range(1, 8)}
    | {f"joint_{i}.temperature": 30.0 + i for i in range(1, 8)}
    | {"bus.voltage": 24.0, "bus.current": 1.25, "tool.x": 0.5, "tool.rz": 1.5, "tool.torque_z": -0.75}
)


def emulated(signals=None) -> Served[KinovaEmulator]:
    """An emulator and where it listens."""
    return with_address(KinovaEmulator(signals or Steady(STILL), "127.0.0.1:0", seed=1))


def driver(place: str, **changes: object) -> KinovaDriver:
    settings = endpoint(place) | {"timeout": "2 s"} | changes
    return KinovaDriver("arm", KinovaSettings.model_validate(settings), CollectingInlet())


def running(place: str, **changes: object) -> AbstractAsyncContextManager[tuple[CollectingInlet, Any]]:
    return once(driver(place, **changes))
