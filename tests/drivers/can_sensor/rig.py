"""An emulated IVT-S and a driver on one loop."""

from __future__ import annotations

import itertools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import numpy as np

from cellwatt.errors import SourceError
from cellwatt_drivers.can_sensor import CanSensorDriver, CanSensorSettings
from cellwatt_drivers.can_sensor.emulator import CanSensorEmulator

from ..inlet import CollectingInlet
from ..running import Steady, served, supervised

FAST = {"cycles": "current=10,voltage_1=20"}
READ = {"read": ["current", "voltage_1"], "rates": {"current": "100 Hz", "voltage_1": "50 Hz"}}
_numbers = itertools.count()


STILL = Steady({"bus.voltage": 48.0, "bus.current": -2.5})


def virtual() -> str:
    """The address of a bus that no other test uses."""
    return f"virtual:test_{next(_numbers)}"


@asynccontextmanager
async def emulated(address: str | None = None, **options: str) -> AsyncIterator[tuple[CanSensorEmulator, str]]:
    """An emulator and its address; that of the port on ``pty``."""
    where = address or virtual()
    emulator = CanSensorEmulator(STILL, where, seed=5, options=FAST | options)
    async with served(emulator) as place:
        yield emulator, place if where == "pty" else where


def settings(place: str, **changes: object) -> CanSensorSettings:
    kind, _, rest = place.partition(":")
    if place.startswith("/"):
        base: dict[str, object] = {"interface": "slcan", "channel": place}
    else:
        base = {"interface": kind, "channel": rest}
    if "map" not in changes:
        base |= {"sensor": "ivt_s", **READ}
    return CanSensorSettings.model_validate(base | changes)


@dataclass
class Run:
    driver: CanSensorDriver
    inlet: CollectingInlet
    failures: list[SourceError]

    def stream(self, name: str) -> np.ndarray:
        """All samples of a stream."""
        return np.concatenate([r.values for r in self.inlet.readings if r.stream.name == name])


@asynccontextmanager
async def running(wanted: CanSensorSettings) -> AsyncIterator[Run]:
    """A driver that is run again when it fails, until the end of the context; the account must be even then."""
    inlet = CollectingInlet()
    run = Run(CanSensorDriver("battery", wanted, inlet), inlet, [])

    async with supervised(run.driver, inlet) as run.failures:
        yield run
