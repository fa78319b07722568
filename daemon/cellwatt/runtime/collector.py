"""The part that collects: sources, the cell's clock, and ticks while no source speaks."""

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
from cellwatt.driver import Driver
from cellwatt.gather import next_moment
from cellwatt.registry import driver as find_driver
from cellwatt.results import Event
from cellwatt.runtime.source import Source
from cellwatt.runtime.tasks import Tasks

log = logging.getLogger(__name__)

AFTER: Final = 0.0005
"""s after the moments at which drivers read, for the question whether any of them spoke."""
RESTS, PERIODS = 70.0, 4.0
"""s without a sample, and periods of the slowest stream, after which ticks and frames stop until one comes: all of a
frame is missing by then."""
Entry = Batch | Tick | Event
"""Items that a collector gives."""


def load_libraries(config: CellConfig) -> None:
    """Import what the drivers of a cell need, as far as it is installed; takes up to a second."""
    for source in config.sources.values():
        for module in find_driver(source.driver).libraries:
            with contextlib.suppress(ImportError):  # the driver says what to install
                importlib.import_module(module)


class Collector:
    """Runs the sources of a cell; ``give`` gets every batch, event and tick in order, on the event loop.

    ``awaited`` says whether somebody waits for samples, which then gather for less long; ``crowded`` whether sources
    may bring no more than they declare.
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
        """Set from a first sample until all sources have been silent for long."""

    def start(self, tasks: Tasks, sequences: Mapping[str, Mapping[str, int]] | None = None) -> None:
        """Begin to read all sources; ``sequences`` says where the numbering of a source's streams goes on."""
        for source in self._config.sources.values():
            self._start_source(tasks, source, (sequences or {}).get(source.name))
        tasks.spawn("ticks", self._ticks())

    def change(self, tasks: Tasks, config: CellConfig, names: Iterable[str]) -> None:
        """Begin anew, or leave out, the sources ``names``, whose devices were let go of."""
        self._config = config
        for name in names:
            before = self.sources.pop(name, None)
            if name in config.sources:
                self._start_source(tasks, config.sources[name], before.sequence if before is not None else None)

    async def stop(self, tasks: Tasks, names: Iterable[str]) -> None:
        """Let go of the devices of some sources."""
        await tasks.end(f"source {name}" for name in names)

    async def close(self, tasks: Tasks) -> None:
        """Let go of all devices."""
        await tasks.end(["ticks", *(f"source {name}" for name in self.sources)])

    def keep_time(self) -> None:
        """Compare the clock with the host's, and let sources say what they held back; to be called once a second."""
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
        driver_class = find_driver(config.driver)

        def make(inlet: Source) -> Driver[Any]:
            driver = driver_class(config.name, config.settings, inlet)
            driver.gather = lambda: self._config.gather(awaited=self._awaited())
            return driver

        source = Source(config.name, make, self.clock.now, self._take, self._give, sequence, self._crowded)
        self.sources[config.name] = source
        tasks.spawn(f"source {config.name}", source.run())

    def _take(self, batch: Batch) -> None:
        self._fresh = True
        self._speaks.set()
        self._give(batch)

    async def _ticks(self) -> None:
        period = max(1 / self._config.frames.rate, self._config.gather(awaited=False))
        heard = 0.0
        while True:
            await self._speaks.wait()
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
