"""A driver and an emulator on one loop."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver, ScpiAnalyzerSettings
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator

from ..inlet import PolledInlet as Inlet
from ..running import Run, Served, Steady, endpoint, repeated, with_address

STILL = Steady({"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0})


def emulated(address: str = "127.0.0.1:0", **options: str) -> Served[ScpiAnalyzerEmulator]:
    """An emulator and where it listens."""
    return with_address(ScpiAnalyzerEmulator(STILL, address, seed=1, options=options))


def settings(place: str, **changes: object) -> ScpiAnalyzerSettings:
    base = {"serial": place} if place.startswith("/") else endpoint(place)
    return ScpiAnalyzerSettings.model_validate(base | changes)


def running(settings: ScpiAnalyzerSettings) -> AbstractAsyncContextManager[Run[ScpiAnalyzerDriver]]:
    return repeated(ScpiAnalyzerDriver("supply", settings, Inlet()))
