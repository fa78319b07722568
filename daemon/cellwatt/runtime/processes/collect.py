"""The process that collects: drivers, time stamps and sequence numbers. Nothing else runs in its interpreter."""

from __future__ import annotations

import asyncio
import gc
import logging
import time
from typing import Final

from cellwatt.ring import ItemWriter, Mark, Status
from cellwatt.runtime.change import Change
from cellwatt.runtime.collector import Collector, Entry, load_libraries
from cellwatt.runtime.processes.rights import claim, settle_memory
from cellwatt.runtime.processes.shared import TELL, Apply, Assignment, Ready, Stop, figures
from cellwatt.runtime.tasks import Tasks
from cellwatt.ticker import Ticker

log = logging.getLogger(__name__)

HEALTH_RATE: Final = 1.0  # Hz
COLLECT: Final = 60.0
"""Period of garbage collection, s."""


def collect(assignment: Assignment) -> None:
    """Read the cell's devices until ``Stop`` is received."""
    load_libraries(assignment.config)
    asyncio.run(_Collecting(assignment).run())


class _Collecting:
    def __init__(self, assignment: Assignment) -> None:
        self._assignment = assignment
        self._config = assignment.config
        self._ring = ItemWriter(assignment.shared.raw)
        raw = assignment.shared.raw
        self._collector = Collector(
            assignment.config, assignment.shared.clock, self._give, lambda: raw.awaited, lambda: raw.crowded(TELL)
        )
        self._rights = claim()
        self._lag = 0.0
        self._given = self._refused = 0
        self._stopping = asyncio.Event()
        self._applying: asyncio.Queue[Apply] = asyncio.Queue()

    async def run(self) -> None:
        control = self._assignment.control
        loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as group:
            self._tasks = Tasks(group)
            self._ring.put(Mark(self._assignment.generation))
            self._collector.start(self._tasks, self._ring.numbers())
            helpers = [group.create_task(self._heart()), group.create_task(self._apply())]
            loop.add_reader(control.fileno(), self._hear)
            log.info("collect: %s", self._rights)
            control.send(Ready())
            settle_memory()
            gc.disable()
            await self._stopping.wait()
            loop.remove_reader(control.fileno())
            for helper in helpers:
                helper.cancel()
            await self._collector.close(self._tasks)
        self._report()
        self._ring.end()

    def _hear(self) -> None:
        try:
            message = self._assignment.control.recv()
        except (EOFError, OSError):  # the supervisor has ended
            message = Stop()
        if isinstance(message, Apply):
            self._applying.put_nowait(message)
        else:
            self._stopping.set()

    async def _apply(self) -> None:
        while True:
            message = await self._applying.get()
            await asyncio.to_thread(load_libraries, message.config)
            change = Change.between(self._config, message.config)
            await self._collector.stop(self._tasks, change.sources)
            self._ring.put(Mark(message.generation))
            self._config = message.config
            self._collector.change(self._tasks, message.config, change.sources)

    def _give(self, entry: Entry) -> None:
        self._given += 1
        try:
            self._ring.put(entry)
        except ValueError:
            # One item that does not fit the ring must not end its driver.
            self._refused += 1
            if self._refused == 1:
                log.exception("an item cannot be passed on")

    async def _heart(self) -> None:
        collected, given = time.monotonic(), -1
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = tick.lateness
                if given == self._given:
                    ticker.skip()  # no items: every other second is enough
                given = self._given
                self._collector.keep_time()
                self._report()
                if time.monotonic() - collected > COLLECT:
                    gc.collect()  # objects of lost connections: takes 1 ms, as older objects are frozen
                    collected = time.monotonic()

    def _report(self) -> None:
        status = figures(
            "collect",
            self._assignment,
            rights=self._rights,
            refused=self._refused,
            loop_lag_ms=round(1e3 * self._lag, 3),
            utc_error_ms=round(self._assignment.shared.clock.utc_error_ns * 1e-6, 3),
            sources=self._collector.status(),
        )
        self._ring.put(Status(status))
