"""A publishing cell as a process: a ``ZenohSink`` over a record in memory, ordered about in JSON lines.

Orders: ``{"stream": {"samples", "frames", "alarms", "rate", "block"}}`` publishes at real time from where it is,
``{"offer_only": n}`` / ``{"record_only": n}`` samples that only go there. Health goes out each 0.2 s.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from typing import Any

from cellwatt.publish import ZenohSettings, ZenohSink
from tests.daemon.publish.fake_cell import EPOCH, STATUS, FakeView, alarm, batch, frames


class Cell:
    def __init__(self, settings: dict[str, Any]) -> None:
        self.view = FakeView(settings.pop("session", EPOCH))
        for session, count in settings.pop("recorded", {}).items():
            self.view.record(batch(0, count), int(session))
        self.sink = ZenohSink("zenoh", ZenohSettings(**settings), self.view)
        self.samples = self.frames = self.alarms = 0

    async def stream(self, samples: int, frames_too: bool, every: int, rate: float, block: int) -> None:
        """``samples`` of one source at ``rate`` Hz in blocks; a frame a block; an alarm every ``every`` blocks."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        for i in range(samples // block):
            await asyncio.sleep(start + i * block / rate - loop.time())
            self.offer(batch(self.samples, block))
            if frames_too:
                self.sink.offer(frames(self.frames, 1))
                self.frames += 1
            if every and i % every == 0:
                self.sink.offer(alarm(self.alarms, active=self.alarms % 2 == 0))
                self.alarms += 1
        say({"published": {"samples": self.samples, "frames": self.frames, "alarms": self.alarms}})

    def offer(self, item: Any, live: bool = True, record: bool = True) -> None:
        self.samples += len(item)
        if record:
            self.view.record(item)
        if live:
            self.sink.offer(item)

    async def beat(self) -> None:
        while True:
            self.sink.health(STATUS)
            await asyncio.sleep(0.2)

    async def obey(self) -> None:
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        async with asyncio.TaskGroup() as group:
            while line := await reader.readline():
                order = json.loads(line)
                if "stream" in order:
                    group.create_task(self.stream(**order["stream"]))
                elif "record_only" in order:
                    self.offer(batch(self.samples, order["record_only"]), live=False)
                elif "offer_only" in order:
                    self.offer(batch(self.samples, order["offer_only"]), record=False)
                elif "alarm" in order:
                    self.sink.offer(alarm(**order["alarm"]))
                elif "account" in order:
                    say({"account": self.sink.account.snapshot()})


def say(what: Any) -> None:
    print(json.dumps(what), flush=True)


async def main() -> None:
    cell = Cell(json.loads(sys.argv[1]))
    serving = asyncio.create_task(cell.sink.run())
    beating = asyncio.create_task(cell.beat())
    say("ready")
    try:
        await cell.obey()
    finally:
        for task in (beating, serving):
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        say({"account": cell.sink.account.snapshot()})


if __name__ == "__main__":
    asyncio.run(main())
