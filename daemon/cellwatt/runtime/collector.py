"""Collection: the sources, the cell's clock, and ticks while no source delivers."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from cellwatt.batch import Batch, Tick
from cellwatt.clock.cell import CellClock
from cellwatt.config import CellConfig, SourceConfig
from cellwatt.gather import next_moment
from cellwatt.registry import driver as find_driver
from cellwatt.results import Event
from cellwatt.runtime.source import Source
from cellwatt.runtime.tasks import Tasks

log = logging.getLogger(__name__)

AFTER: Final = 0.0005
"""Delay in s, after the times at which drivers read, of the check whether any of them delivered."""
RESTS, PERIODS = 70.0, 4.0
"""s without a sample, and periods of the slowest stream, after which ticks and frames pause until the next sample: all
values of a frame are missing by then."""
Entry = Batch | Tick | Event
"""Items that a collector passes on."""


def load_libraries(config: CellConfig) -> None:
    """Import the installed libraries that the drivers of a cell need; takes up to a second."""
    for source in config.sources.values():
        for module in find_driver(source.driver).libraries:
            with contextlib.suppress(Exception):  # the driver imports it again and reports why that fails
                importlib.import_module(module)


class Collector:
    """Runs the sources of a cell; ``give`` is called with every batch, event and tick in order, on the event loop.

    ``awaited`` returns whether a consumer waits for samples, which then gather for a shorter time; ``crowded`` whether
    sources are limited to their declared rates.
    """

    def __init__(
        self,
        config: CellConfig,
        clock: CellClock,
        give: Callable[[Entry], None],
        awaited: Callable[[], bool] = lambda: True,
        crowded: Callable[[], bool] = lambda: False,
    ) -> None:
        self.clock = clock
        self.sources: dict[str, Source] = {}
        self._config = config
        self._give = give
        self._awaited, self._crowded = awaited, crowded
        self._fresh = False
        self._speaks = asyncio.Event()
        """Set by a sample, cleared when all sources have been silent for long."""

    def start(self, tasks: Tasks, sequences: Mapping[str, Mapping[str, int]] | None = None) -> None:
        """Start reading all sources; ``sequences`` holds the next number of each stream by source."""
        for source in self._config.sources.values():
            self._start_source(tasks, source, (sequences or {}).get(source.name))
        tasks.spawn("ticks", self._ticks())

    def change(self, tasks: Tasks, config: CellConfig, names: Iterable[str]) -> None:
        """Restart those of the stopped sources ``names`` that the new settings still contain."""
        self._config = config
        for name in names:
            before = self.sources.pop(name, None)
            if name in config.sources:
                self._start_source(tasks, config.sources[name], before.sequence if before is not None else None)

    async def stop(self, tasks: Tasks, names: Iterable[str]) -> None:
        """Stop the sources ``names`` and release their devices."""
        await tasks.end(f"source {name}" for name in names)

    async def close(self, tasks: Tasks) -> None:
        """Stop all sources and release their devices."""
        await tasks.end(["ticks", *(f"source {name}" for name in self.sources)])

    def keep_time(self) -> None:
        """Compare the clock with the host's, and let sources report held-back events; call once a second."""
        for source in self.sources.values():
            source.settle()
        step = self.clock.discipline() * 1e-9
        if step:
            text = (
                f"the host's wall clock was set by {step:+.3f} s; "
                "the cell's time does not jump but follows by at most 500 ppm"
            )
            log.warning("%s", text)
            self._give(Event(self.clock.now(), None, "wall_clock_step", text, {"step_s": step}))

    def status(self) -> dict[str, Any]:
        """Figures of each source for health, JSON-ready."""
        return {name: source.status() for name, source in self.sources.items()}

    def _start_source(self, tasks: Tasks, config: SourceConfig, sequence: Mapping[str, int] | None) -> None:
        driver, now = find_driver(config.driver), self.clock.now
        source = Source(config.name, driver, config.settings, now, self._take, self._give, sequence, self._crowded)
        source.driver.gather = lambda: self._config.gather(awaited=self._awaited())
        self.sources[config.name] = source
        tasks.spawn(f"source {config.name}", source.run())

    def _take(self, batch: Batch) -> None:
        self._fresh = True
        self._speaks.set()
        self._give(batch)

    async def _ticks(self) -> None:
        heard = 0.0
        while True:
            await self._speaks.wait()
            period = max(1 / self._config.frames.rate, self._config.gather(awaited=False))
            await asyncio.sleep(next_moment(period, AFTER) - time.monotonic())
            now = time.monotonic()
            if self._fresh:
                heard, self._fresh = now, False
            elif now - heard > self._rests():
                self._speaks.clear()
            else:
                self._give(Tick(self.clock.now()))

    def _rests(self) -> float:
        streams = [stream for source in self.sources.values() for stream in source.driver.streams]
        return max([RESTS, *(PERIODS / stream.rate for stream in streams if stream.rate)])
