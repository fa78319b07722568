"""A publishing cell as a process: a ``ZenohOutlet`` over a record in memory or in a ``folder``.

Orders, in JSON lines: ``{"stream": {"samples", "frames_too", "every", "rate", "block"}}`` publishes at real time from
where it is, without a number of samples until ``{"halt": true}``; ``{"samples": n}`` and ``{"frames": n}`` at once. It
says what was published at the end of each, and when asked to ``{"tell": true}``. Health goes out each 0.2 s.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import sys
from pathlib import Path
from typing import Any

from cellwatt import Batch, Frames
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.record import Header, History, Recorder, RecordSettings
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, STATUS, FakeView, alarm, batch, frames
from tests.daemon.outlets.zenoh.recorded_cell import RecordedView
from tests.doing import doing
from tests.orders import orders, say
from tests.patience import PATIENCE

BLOCK, FLUSH = 10, 500
"""Samples or frames at once: those of a block, and those after which the record is flushed."""


class RecordingView(RecordedView):
    """The cell with a record on disk."""

    def __init__(self, session: int, folder: Path, record: dict[str, Any]) -> None:
        self.recorder = Recorder(RecordSettings(folder=folder, **record), Header(SITE, CELL, session))
        self.recorder.start()
        super().__init__(History(folder, self.recorder), session)

    def record(self, item: Batch | Frames, session: int | None = None) -> None:
        assert self.recorder.put(item)


class Cell:
    def __init__(self, settings: dict[str, Any]) -> None:
        session, folder = settings.pop("session", EPOCH), settings.pop("folder", None)
        site, record = settings.pop("site", SITE), settings.pop("record", {})
        self.recorded = None if folder is None else RecordingView(session, Path(folder), record)
        self.view = self.recorded or FakeView(session)
        self.view.site = site
        for session, count in settings.pop("recorded", {}).items():
            self.view.record(batch(0, count), int(session))
        self.outlet = ZenohOutlet("zenoh", ZenohSettings(**settings), self.view)
        self.samples = self.frames = self.alarms = 0
        self.halted = False

    async def stream(self, samples: int | None, frames_too: bool, every: int, rate: float, block: int) -> None:
        """``samples`` of one source at ``rate`` Hz in blocks; a frame a block; an alarm every ``every`` blocks."""
        loop = asyncio.get_running_loop()
        start, self.halted = loop.time(), False
        for i in itertools.count() if samples is None else range(samples // block):
            await asyncio.sleep(start + i * block / rate - loop.time())
            if self.halted:
                break
            self.offer(batch(self.samples, block))
            if frames_too:
                self.offer_frames(1)
            if every and i % every == 0:
                self.outlet.offer(alarm(self.alarms, active=self.alarms % 2 == 0))
                self.alarms += 1
        self.say_published()

    def offer_frames(self, count: int) -> None:
        self.view.record(frames(self.frames, count))
        self.outlet.offer(frames(self.frames, count))
        self.frames += count

    async def burst(self, *, samples: int = 0, frames: int = 0) -> None:
        """Samples or frames at once, in blocks; they are on disk when it says so."""
        for end in range(BLOCK, samples + frames + 1, BLOCK):
            if samples:
                self.offer(batch(self.samples, BLOCK))
            else:
                self.offer_frames(BLOCK)
            if self.recorded is not None and (end == samples + frames or end % FLUSH == 0):
                assert await asyncio.to_thread(self.recorded.recorder.flush, PATIENCE)
        self.say_published()

    def say_published(self) -> None:
        made = {"samples": self.samples, "frames": self.frames, "alarms": self.alarms}
        say({"published": made})

    def offer(self, item: Any) -> None:
        self.samples += len(item)
        self.view.record(item)
        self.outlet.offer(item)

    async def beat(self) -> None:
        while True:
            self.outlet.health(STATUS)
            await asyncio.sleep(0.2)

    async def obey(self) -> None:
        async with asyncio.TaskGroup() as group:
            async for order in orders():
                if "stream" in order:
                    group.create_task(self.stream(**order["stream"]))
                elif order.keys() & {"samples", "frames"}:
                    group.create_task(self.burst(**order))
                elif "halt" in order:
                    self.halted = True
                elif "tell" in order:
                    self.say_published()
                elif "alarm" in order:
                    self.outlet.offer(alarm(**order["alarm"]))
                elif "account" in order:
                    say({"account": self.outlet.account.snapshot()})
            self.halted = True


async def main() -> None:
    cell = Cell(json.loads(sys.argv[1]))
    try:
        async with doing(cell.outlet.run(), cell.beat()):
            say("ready")
            await cell.obey()
    finally:
        if cell.recorded is not None:
            await cell.recorded.recorder.close()
        say({"account": cell.outlet.account.snapshot()})


if __name__ == "__main__":
    asyncio.run(main())
