"""Emulated meters and drivers on one loop."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import SimData, SimDevice

from cellwatt_drivers.modbus_meter import ModbusMeterDriver, ModbusMeterSettings
from cellwatt_drivers.modbus_meter.emulator import ModbusMeterEmulator

from ..inlet import CollectingInlet
from ..running import Run, Served, Steady, endpoint, repeated, with_address

STILL = Steady({"supply.voltage": 230.0, "supply.current": 2.5, "supply.power": 500.0})


def emulated(address: str = "127.0.0.1:0", **options: str) -> Served[ModbusMeterEmulator]:
    """An emulator and where it listens."""
    return with_address(ModbusMeterEmulator(STILL, address, seed=3, options=options))


@asynccontextmanager
async def answering(*registers: SimData, **more: Any) -> AsyncIterator[str]:
    """pymodbus's own server with these registers for any unit, and where it listens."""
    server = ModbusTcpServer(SimDevice(0, simdata=list(registers)), address=("127.0.0.1", 0), **more)
    await server.serve_forever(background=True)
    try:
        yield f"127.0.0.1:{server.transport.sockets[0].getsockname()[1]}"
    finally:
        await server.shutdown()


def settings(place: str, **changes: object) -> ModbusMeterSettings:
    base = {"line": place, "parity": "none"} if place.startswith("/") else endpoint(place)
    if "map" not in changes:
        base["meter"] = "eastron_sdm630"
    return ModbusMeterSettings.model_validate(base | {"rate": "20 Hz"} | changes)


def running(wanted: ModbusMeterSettings) -> AbstractAsyncContextManager[Run[ModbusMeterDriver]]:
    return repeated(ModbusMeterDriver("meter", wanted, CollectingInlet()))
