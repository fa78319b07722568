"""A driver and an emulator on one loop, and an inlet that keeps what it is given."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from cellwatt.errors import SourceError
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver, ScpiAnalyzerSettings
from cellwatt_drivers.scpi_analyzer.emulator import ScpiAnalyzerEmulator

from ..inlet import PolledInlet
from ..running import Steady, served, supervised


class Inlet(PolledInlet):
    def __init__(self) -> None:
        super().__init__()
        self.failures: list[SourceError] = []


STILL = Steady({"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0})


@asynccontextmanager
async def emulated(address: str = "127.0.0.1:0", **options: str) -> AsyncIterator[tuple[ScpiAnalyzerEmulator, str]]:
    """An emulator and where it listens."""
    emulator = ScpiAnalyzerEmulator(STILL, address, seed=1, options=options)
    async with served(emulator) as address:
        yield emulator, address


def settings(place: str, **changes: object) -> ScpiAnalyzerSettings:
    if place.startswith("/"):
        base: dict[str, object] = {"serial": place}
    else:
        host, _, port = place.rpartition(":")
        base = {"host": host, "port": int(port)}
    return ScpiAnalyzerSettings.model_validate(base | changes)


@asynccontextmanager
async def running(settings: ScpiAnalyzerSettings) -> AsyncIterator[tuple[ScpiAnalyzerDriver, Inlet]]:
    """A driver that is run again when it fails, until the end of the context; the account must be even then."""
    inlet = Inlet()
    driver = ScpiAnalyzerDriver("supply", settings, inlet)

    async with supervised(driver, inlet) as inlet.failures:
        yield driver, inlet
