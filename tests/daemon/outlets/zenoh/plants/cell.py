"""A cell as a process: the Zenoh outlet over a record on disk, ordered about in JSON lines.

python -m PACKAGE.cell '{"site", "cell", "folder", "zenoh": settings, "record": settings, "rate": Hz, "width": n}'

``{"run": s}`` records and publishes samples, frames and alarms in real time until that time is over (``null``: until
``{"halt": true}``); ``{"past": h}`` records hours at once, with time stamps of that long. ``{"tell": true}`` says what
was made, and the counts of the outlet.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import Any

import numpy as np

from cellwatt import Batch, Channel, Stream
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.record import Header, History, Recorder, RecordSettings
from tests.blocks import frames_of, layout_of
from tests.daemon.outlets.zenoh.fake_cell import alarm
from tests.daemon.outlets.zenoh.recorded_cell import RecordedView
from tests.doing import doing
from tests.orders import orders, say

FRAME_RATE = 50.0


class View(RecordedView):
    """What the outlet asks of its cell."""

    def __init__(self, site: str, cell: str, recorder: Recorder) -> None:
        super().__init__(History(recorder.settings.folder, recorder), recorder.session, cell)
        self.site, self.record_folder = site, recorder.settings.folder


class Cell:
    """Samples whose first value is their number; frames and alarms likewise."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.rate, self.width = float(order["rate"]), int(order["width"])
        channels = tuple(Channel(f"joint_{i + 1}.position", "rad") for i in range(self.width))
        self.stream = Stream("samples", channels, self.rate, "host")
        self.layout = layout_of({"arm.joint_1.position": "rad"}, FRAME_RATE)
        header = Header(order["site"], order["cell"], time.time_ns(), robot="ur10e", settings="")
        record = RecordSettings(**{**order["record"], "folder": order["folder"]})
        self.recorder = Recorder(record, header)
        self.view = View(order["site"], order["cell"], self.recorder)
        self.outlet = ZenohOutlet("zenoh", ZenohSettings(**order["zenoh"]), self.view)
        self.samples = self.frames = self.alarms = 0
        self.clock = self.recorder.session
        """UTC ns of the next sample."""
        self.halted = asyncio.Event()

    def make(self, count: int, step: float, arrival: int | None = None) -> None:
        """Record and publish the next samples, ``step`` ns apart."""
        numbers = np.arange(self.samples, self.samples + count)
        times = self.clock + (np.arange(count) * step).astype(np.int64)
        values = numbers[:, None] + np.arange(self.width) / 16
        about = {"bound": np.full(count, 1000), "quality": np.zeros(count, np.uint8), "device_time": None}
        at = int(times[-1]) if arrival is None else arrival
        batch = Batch("arm", self.stream, self.samples, at, time=times, values=values, **about)
        self.recorder.put(batch)
        self.outlet.offer(batch)
        self.samples += count
        self.clock += int(count * step)

    def make_frames(self, count: int) -> None:
        numbers = np.arange(self.frames, self.frames + count)
        time_of = time.time_ns() + ((numbers - numbers[-1]) * 1e9 / FRAME_RATE).astype(np.int64)
        self.outlet.offer(frames_of(self.layout, self.frames, time_of, numbers[:, None] + 0.25))
        self.frames += count

    def make_alarm(self) -> None:
        now = time.time_ns()
        self.outlet.offer(alarm(self.alarms, active=False, since=now, time=now))
        self.alarms += 1

    async def run(self, seconds: float | None, block: float = 0.02) -> None:
        """Samples, frames and alarms in real time."""
        loop, each = asyncio.get_running_loop(), max(round(self.rate * block), 1)
        self.halted.clear()
        begin, ticks = loop.time(), 0
        while not self.halted.is_set() and (seconds is None or ticks * block < seconds):
            ticks += 1
            await asyncio.sleep(begin + ticks * block - loop.time())
            self.make(each, 1e9 * block / each, time.time_ns())
            if ticks % 5 == 0:
                self.make_frames(5)
            if ticks % 50 == 0:
                self.make_alarm()
        say({"ran": self.made()})

    async def past(self, hours: float, block: int = 250) -> None:
        """Hours of samples at once, as fast as the disk takes them."""
        for n in range(round(hours * 3600 * self.rate / block)):
            self.make(block, 1e9 / self.rate)
            if n % 20 == 0:
                await asyncio.sleep(0.2 if self.recorder.stats()["queue"]["bytes"] > 16e6 else 0)
        await asyncio.to_thread(self.recorder.flush, 60.0)
        say({"past": self.made()})

    def made(self) -> dict[str, Any]:
        counts = {"samples": self.samples, "frames": self.frames, "alarms": self.alarms}
        return {**counts, "account": self.outlet.account.snapshot()}

    async def beat(self) -> None:
        while True:
            self.outlet.health({"state": "green"})
            await asyncio.sleep(0.5)

    async def obey(self) -> None:
        async with asyncio.TaskGroup() as group:
            async for order in orders():
                if "run" in order:
                    group.create_task(self.run(order["run"]))
                elif "past" in order:
                    group.create_task(self.past(order["past"]))
                elif "halt" in order:
                    self.halted.set()
                elif "tell" in order:
                    say({"told": self.made()})
            self.halted.set()


async def main() -> None:
    cell = Cell(json.loads(sys.argv[1]))
    cell.recorder.start()
    try:
        async with doing(cell.outlet.run(), cell.beat()):
            say("ready")
            await cell.obey()
    finally:
        await cell.recorder.close()


if __name__ == "__main__":
    asyncio.run(main())
