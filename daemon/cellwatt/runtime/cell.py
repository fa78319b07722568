"""Sources, frames and record of a cell in one process, without stages: ``cellwatt record``."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from typing import Any

from cellwatt.cell_clock import CellClock
from cellwatt.config import CellConfig
from cellwatt.frames import Frames
from cellwatt.results import Event
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.collector import Collector, Entry, load_libraries
from cellwatt.runtime.framer import Framer
from cellwatt.runtime.tasks import Tasks, plain_errors
from cellwatt.runtime.teller import Teller
from cellwatt.ticker import Ticker

log = logging.getLogger(__name__)

HEALTH_RATE = 1.0  # Hz


class Cell:
    """One cell whose sources are recorded. ``run`` serves until ``stop`` is called."""

    def __init__(self, config: CellConfig) -> None:
        self._config = config
        self.clock = CellClock()
        self.session = self.clock.now()
        self.view = Teller(config, self.session, self.clock.now)
        self._collector = Collector(config, self.clock, self._take)
        self._framer = Framer({}, config.frames)
        self._lag = 0.0
        self._stopping = asyncio.Event()

    async def run(self) -> None:
        """Serve until ``stop``; then drain and close. Raises ``CellwattError`` where a part cannot be started."""
        with plain_errors():
            async with asyncio.TaskGroup() as group:
                tasks = Tasks(group)
                streams, layout = declared(self._config)
                load_libraries(self._config)
                await self.view.start(tasks, streams, layout)
                self._framer.change(streams, self._config.frames)
                self._collector.start(tasks)
                heart = group.create_task(self._heart(), name="heart")
                await self._stopping.wait()
                await self._collector.close(tasks)
                self._give_frames(self._framer.flush())
                self._look()
                await self.view.close(tasks)
                heart.cancel()

    def stop(self) -> None:
        """End ``run`` in order: sources first, then what is queued, then the record."""
        self._stopping.set()

    def _take(self, entry: Entry) -> None:
        self.view.take(entry)
        if not isinstance(entry, Event):
            self._give_frames(self._framer.take(entry))

    def _give_frames(self, blocks: Iterable[Frames]) -> None:
        for frames in blocks:
            self.view.take(frames)

    async def _heart(self) -> None:
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = tick.lateness
                try:
                    self._collector.keep_time()
                    self._look()
                except Exception:
                    # Health is worth a lot, but never the data: it is looked at again in a second.
                    log.exception("the look at the cell's health failed")

    def _look(self, **stages: Any) -> None:
        parts = {
            "utc_error_ms": round(self.clock.utc_error_ns * 1e-6, 3),
            "loop_lag_ms": round(1e3 * self._lag, 3),
            "sources": self._collector.status(),
            "frames": self._framer.status(),
        }
        self.view.look({**parts, "stages": stages})
