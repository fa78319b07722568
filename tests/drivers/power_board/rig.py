"""A driver, an emulator on the same loop with a real pty between them, and an inlet that keeps everything."""

from __future__ import annotations

from contextlib import asynccontextmanager
from itertools import pairwise

import numpy as np

from cellwatt import Reading, Stream
from cellwatt_drivers.power_board import PowerBoardDriver, PowerBoardSettings
from cellwatt_drivers.power_board.emulator import PowerBoardEmulator
from tests.drivers.inlet import CollectingInlet
from tests.drivers.power_board.samples import Slope
from tests.drivers.running import Served, repeated, with_address
from tests.patience import eventually


class Inlet(CollectingInlet):
    """The account must add up at every reading, and device time must rise; keeps the texts of events."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self._newest: dict[str, int] = {}

    def emit(self, reading: Reading) -> None:
        assert reading.device_time is not None
        times = [self._newest.get(reading.stream.name, -(2**63)), *reading.device_time.tolist()]
        assert all(a < b for a, b in pairwise(times)), "device time must rise"
        self._newest[reading.stream.name] = times[-1]
        super().emit(reading)

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a board is never asked anything")

    def clock_reset(self, stream: Stream, reason: str) -> None:
        super().clock_reset(stream, reason)
        self._newest.pop(stream.name, None)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.texts.append(text)

    def channel(self, channel: str) -> np.ndarray:
        """All values of a channel, in the order in which they were given."""
        return np.concatenate([r.values[:, r.stream.names.index(channel)] for r in self.readings])


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
