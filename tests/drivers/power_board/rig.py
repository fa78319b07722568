"""A driver, an emulator on the same loop with a real pty between them, and an inlet that keeps everything."""

from __future__ import annotations

from contextlib import asynccontextmanager

from cellwatt import Stream
from cellwatt_drivers.power_board import PowerBoardDriver, PowerBoardSettings
from cellwatt_drivers.power_board.emulator import PowerBoardEmulator
from tests.drivers.inlet import CollectingInlet
from tests.drivers.power_board.samples import Slope
from tests.drivers.running import Served, repeated, with_address
from tests.patience import eventually


class Inlet(CollectingInlet):
    """Of a board, which only sends."""

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a board is never asked anything")


def emulated(**options: str) -> Served[PowerBoardEmulator]:
    """An emulator that serves, and its port."""
    return with_address(PowerBoardEmulator(Slope(), "pty", seed=3, options=options))


@asynccontextmanager
async def cell(settings: dict | None = None, **options: str):
    """Emulator, supervised driver and inlet, all going: yields (emulator, run)."""
    async with emulated(**options) as (emulator, port):
        given = {"port": port, "rate": "123 Hz", "reorder": "5 s"} | (settings or {})
        given.setdefault("mode", options.get("mode", "api"))
        given.setdefault("phases", int(options.get("phases", "3")))
        async with repeated(PowerBoardDriver("board", PowerBoardSettings(**given), Inlet())) as run:
            yield emulator, run


async def settled(emulator: PowerBoardEmulator, inlet: Inlet, samples: int) -> dict[str, int]:
    """Wait until the driver has accounted for everything made, at least ``samples``; the emulator's counts then."""

    def even() -> bool:
        return inlet.account.expected == emulator.counts["made"] >= samples

    await eventually(even)
    return dict(emulator.counts)
