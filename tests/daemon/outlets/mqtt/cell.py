"""A cell without a daemon: frames whose values say which they are, and a record that grows."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt import Alarm, FrameChannel, Frames, Layout
from cellwatt.errors import OutletError
from cellwatt.outlets.mqtt.outlet import MqttOutlet
from cellwatt.outlets.mqtt.settings import MqttSettings
from tests.blocks import frames_of, marked
from tests.daemon.outlets.mqtt.broker import Broker, Ears, ears
from tests.daemon.outlets.page.recorded import Written
from tests.daemon.outlets.zenoh import fake_cell
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE, FakeView
from tests.doing import doing

ROOT = f"cellwatt/{SITE}/{CELL}"
LAYOUT = Layout(
    (
        FrameChannel("arm.joint_1.position", "rad", "continuous", "linear"),
        FrameChannel("arm.supply.power", "W", "continuous", "average"),
        FrameChannel("meter.energy", "J", "counter", "hold"),
    ),
    50.0,
)
STEP = LAYOUT.step


class Cell(FakeView):
    """A running cell: ``frames`` makes the next ones, and writes them to the record if there is one."""

    def __init__(self, folder: Path | None = None) -> None:
        super().__init__(time.time_ns() - STEP, record_folder=folder)
        self.folder = folder or Path("/nonexistent")
        self.start = -(-time.time_ns() // STEP) * STEP
        self.next = 0
        self.state = "green"
        self.may_connect = asyncio.Event()
        """Cleared, the outlet is not run again: so somebody can listen before it speaks."""
        self.may_connect.set()
        self.record = None if folder is None else Written(folder, session=self.session, cell=CELL)

    def frames(self, count: int = 1, missing: tuple[str, ...] = ()) -> Frames:
        """The next frames; frame n has the values n, 10 n and 100 n."""
        numbers = np.arange(self.next, self.next + count)
        self.next += count
        values = numbers[:, None] * np.array([1.0, 10.0, 100.0])
        for i, name in enumerate(LAYOUT.names):
            if name.split(".")[0] in missing:
                values[:, i] = np.nan
        made = frames_of(LAYOUT, int(numbers[0]), self.start + numbers * STEP, values, marked(values))
        if self.record is not None:
            self.record.chunk(made)
        return made

    def close(self) -> None:
        if self.record is not None:
            self.record.close()

    def number(self, row_time: int) -> int:
        """Number of the frame at a time, ns."""
        return round((row_time - self.start) / STEP)

    def status(self) -> Mapping[str, Any]:
        return {"state": self.state, **self.alarms.status(), "site": SITE, "cell": CELL}


def alarm(number: int, active: bool = True, **more: Any) -> Alarm:
    now = time.time_ns()
    return fake_cell.alarm(number, active, id=f"faults.arm.{number}", since=now, time=now, **more)


def outlet_of(cell: Cell, broker: str, **settings: Any) -> MqttOutlet:
    return MqttOutlet("mqtt", MqttSettings.model_validate({"broker": broker, "rate": "50 Hz", **settings}), cell)


@asynccontextmanager
async def serving(outlet: MqttOutlet, cell: Cell) -> AsyncIterator[list[str]]:
    """Run an outlet as the daemon does, and again when it ends; gives why it ended."""
    ends: list[str] = []

    async def run() -> None:
        while True:
            await cell.may_connect.wait()
            try:
                await outlet.run()
            except OutletError as error:
                ends.append(str(error))
            await asyncio.sleep(0.05)

    async def beat() -> None:
        while True:
            outlet.health(cell.status())
            await asyncio.sleep(0.02)

    async with doing(beat(), run()):
        yield ends


@asynccontextmanager
async def online(broker: Broker, cell: Cell, **settings: Any) -> AsyncIterator[tuple[MqttOutlet, Ears]]:
    """The outlet of a cell, once it is available at a broker, and ears for all that it says."""
    outlet = outlet_of(cell, broker.url, **settings)
    async with ears(broker, f"{ROOT}/#") as heard, serving(outlet, cell):
        await heard.until(f"{ROOT}/availability")
        yield outlet, heard
