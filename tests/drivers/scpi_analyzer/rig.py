"""A driver and an emulator on one loop."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager

from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver, ScpiAnalyzerSettings
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator

from ..inlet import PolledInlet as Inlet
from ..running import Run, Steady, endpoint, repeated, served

STILL = Steady({"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0})


@asynccontextmanager
async def emulated(address: str = "127.0.0.1:0", **options: str) -> AsyncIterator[tuple[ScpiAnalyzerEmulator, str]]:
    """An emulator and where it listens."""
    emulator = ScpiAnalyzerEmulator(STILL, address, seed=1, options=options)
    async with served(emulator) as address:
        yield emulator, address


def settings(place: str, **changes: object) -> ScpiAnalyzerSettings:
    base = {"serial": place} if place.startswith("/") else endpoint(place)
    return ScpiAnalyzerSettings.model_validate(base | changes)


def running(settings: ScpiAnalyzerSettings) -> AbstractAsyncContextManager[Run[ScpiAnalyzerDriver]]:
    return repeated(ScpiAnalyzerDriver("supply", settings, Inlet()))
