"""The daemon: one cell from its sources to its sinks."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from cellwatt.align import Aligner
from cellwatt.batch import Batch, Tick
from cellwatt.cell_clock import CellClock
from cellwatt.config import CellConfig, SinkConfig, SourceConfig, public_config
from cellwatt.driver import Driver
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.record import Header, History, Recorder
from cellwatt.registry import driver as find_driver
from cellwatt.registry import sink as find_sink
from cellwatt.results import Alarm, Event, Result
from cellwatt.runtime.assemble import Prepared, prepare, streams_of
from cellwatt.runtime.delivery import Delivery
from cellwatt.runtime.health import alignment, colour, describe
from cellwatt.runtime.source import Source
from cellwatt.runtime.watch import Watch
from cellwatt.runtime.worker import Worker
from cellwatt.sink import Item
from cellwatt.ticker import Ticker

log = logging.getLogger(__name__)

HEALTH_RATE = 1.0  # Hz
DRAIN = 5.0
"""Longest time, s, that a stop waits for stages and sinks to finish what is queued."""


class Cell:
    """One running cell. ``run`` serves until ``stop`` is called; ``reload`` applies what changed in the settings."""

    def __init__(self, config: CellConfig) -> None:
        self._config = config
        self.clock = CellClock()
        self.session = self.clock.now()
        self.site, self.cell = config.site, config.cell
        self._sources: dict[str, Source] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._sinks: dict[str, Delivery] = {}
        self._workers: list[Worker] = []
        self._recorder: Recorder | None = None
        self._history: History | None = None
        self._aligner = Aligner({}, config.frames.rate, config.frames.latency)
        self._frames = 0
        self._results = 0
        self._fresh = False
        self._began = asyncio.Event()
        self._active: dict[str, Alarm] = {}
        self._watch = Watch()
        self._status: dict[str, Any] = {}
        self._lag = 0.0
        self._stopping = asyncio.Event()
        self._changing = asyncio.Lock()
        """Held while parts are started, changed or ended."""
        self._group: asyncio.TaskGroup | None = None
        self.on_health: Callable[[Mapping[str, Any]], None] = lambda _status: None

    # life -----------------------------------------------------------------------------------------

    async def run(self, ready: Callable[[], None] = lambda: None) -> None:
        """Serve until ``stop``; then drain and close. ``ready`` is called once everything is started.

        Raises ``CellwattError`` where a part cannot be started.
        """
        try:
            await self._serve(ready)
        except ExceptionGroup as failures:
            if all(isinstance(error, CellwattError) for error in failures.exceptions):
                raise failures.exceptions[0] from None
            raise

    async def _serve(self, ready: Callable[[], None]) -> None:
        async with asyncio.TaskGroup() as self._group:
            async with self._changing:
                prepared = await asyncio.to_thread(prepare, self._config)
                await self._start_record()
                for sink in self._config.sinks.values():
                    self._start_sink(sink)
                for source in self._config.sources.values():
                    self._start_source(source)
                self._build_frames(prepared)
                heart = self._group.create_task(self._heart(), name="heart")
                self._spawn("ticks", self._ticks())
                self._look()
            ready()
            await self._stopping.wait()
            async with self._changing:
                await self._shut_down()
            heart.cancel()

    def stop(self) -> None:
        """End ``run`` in order: sources first, then what is queued, then sinks and record."""
        self._stopping.set()

    async def _shut_down(self) -> None:
        await self._end(["ticks", *(f"source {name}" for name in self._sources)])
        self._flush()
        await self._end_workers()
        self._look()
        await self._end(f"sink {name}" for name in list(self._sinks))
        if self._recorder is not None:
            await self._recorder.close()

    async def _end(self, names: Any) -> None:
        tasks = [self._tasks.pop(n) for n in list(names) if n in self._tasks]
        for task in tasks:
            task.cancel()
        if tasks:
            _, late = await asyncio.wait(tasks, timeout=DRAIN)
            for task in late:
                log.warning("%s did not end within %.0f s: it is cut off", task.get_name(), DRAIN)
                task.cancel()

    async def _end_workers(self) -> None:
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.finish()
        names = [n for n in self._tasks if n.startswith("stages ")]
        tasks = [self._tasks.pop(n) for n in names]
        if tasks:
            _, late = await asyncio.wait(tasks, timeout=DRAIN)
            for task in late:
                log.warning("%s still busy after %.0f s: what it had queued is lost", task.get_name(), DRAIN)
                task.cancel()

    def _spawn(self, name: str, work: Any) -> None:
        assert self._group is not None
        self._tasks[name] = self._group.create_task(work, name=name)

    # parts ----------------------------------------------------------------------------------------

    async def _start_record(self) -> None:
        settings = self._config.record
        if settings is None:
            return
        self._recorder = Recorder(settings, self._header())
        await asyncio.to_thread(self._recorder.start)
        self._history = History(settings.folder, self._recorder)
        self._spawn("recovery", self._report_recovery(self._recorder))

    def _header(self) -> Header:
        streams = {name: streams_of(source) for name, source in self._config.sources.items()}
        return Header(self.site, self.cell, self.session, self._config.robot, self._config.text, streams)

    async def _report_recovery(self, recorder: Recorder) -> None:
        for recovery in await recorder.recovered():
            self._tell(Event(self.clock.now(), None, "recovered", str(recovery)))

    def _start_source(self, config: SourceConfig) -> None:
        driver_class = find_driver(config.driver)

        def make(outlet: Source) -> Driver[Any]:
            return driver_class(config.name, config.settings, outlet)

        before = self._sources.get(config.name)
        sequence = before.sequence if before is not None else None
        source = Source(config.name, make, self.clock.now, self._take, self._tell, sequence)
        self._sources[config.name] = source
        self._spawn(f"source {config.name}", source.run())

    def _start_sink(self, config: SinkConfig) -> None:
        sink = find_sink(config.name)(config.name, config.settings, self)
        delivery = self._sinks[config.name] = Delivery(config.name, sink)
        self._spawn(f"sink {config.name}", delivery.run())

    def _build_frames(self, prepared: Prepared) -> None:
        frames = self._config.frames
        self._aligner = Aligner(prepared.streams, frames.rate, frames.latency)
        for chain in prepared.chains:
            worker = Worker(chain, self._give_results)
            self._workers.append(worker)
            self._spawn(f"stages {'+'.join(chain.names)}", worker.run())

    def _flush(self) -> None:
        for frames in self._aligner.flush():
            self._give_frames(frames)

    # data -----------------------------------------------------------------------------------------

    def _take(self, batch: Batch) -> None:
        if self._recorder is not None and not self._recorder.batch(batch):
            self._sources[batch.source].account.count("not recorded", len(batch))
        self._offer(batch)
        self._fresh = True
        self._began.set()
        for frames in self._aligner.add(batch):
            self._give_frames(frames)

    async def _ticks(self) -> None:
        await self._began.wait()
        async with Ticker(self._config.frames.rate) as ticker:
            async for _ in ticker:
                if not self._fresh:
                    tick = Tick(self.clock.now())
                    if self._recorder is not None:
                        self._recorder.tick(tick)
                    for frames in self._aligner.tick(tick):
                        self._give_frames(frames)
                self._fresh = False

    def _give_frames(self, frames: Frames) -> None:
        # A reload begins with a new aligner; the numbering goes on.
        frames = replace(frames, sequence=self._frames)
        self._frames += len(frames)
        if self._recorder is not None:
            self._recorder.frames(frames)
        self._offer(frames)
        for worker in self._workers:
            worker.offer(frames)

    def _give_results(self, results: Sequence[Result]) -> None:
        for result in results:
            self._results += 1
            if isinstance(result, Alarm):
                self._note_alarm(result)
            if self._recorder is not None:
                self._recorder.result(result)
            self._offer(result)

    def _note_alarm(self, alarm: Alarm) -> None:
        if not alarm.active or alarm.id not in self._active:
            log.warning("%s: %s", alarm.severity if alarm.active else "cleared", alarm.statement)
        if alarm.active:
            self._active[alarm.id] = alarm
        else:
            self._active.pop(alarm.id, None)

    def _tell(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.event(event)
        self._offer(event)

    def _offer(self, item: Item) -> None:
        for sink in self._sinks.values():
            sink.offer(item)

    # health ---------------------------------------------------------------------------------------

    async def _heart(self) -> None:
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = max(0.0, (asyncio.get_running_loop().time() - tick.deadline * 1e-9))
                try:
                    self._keep_time()
                    self._look()
                except Exception:
                    # Health is worth a lot, but never the data: it is looked at again in a second.
                    log.exception("the look at the cell's health failed")

    def _keep_time(self) -> None:
        step = self.clock.discipline() * 1e-9
        if step:
            text = (
                f"the host's wall clock was set by {step:+.3f} s; "
                "the cell's time does not jump but follows by at most 500 ppm"
            )
            log.warning("%s", text)
            self._tell(Event(self.clock.now(), None, "wall_clock_step", text, {"step_s": step}))

    def _look(self) -> None:
        self._status = self._measure()
        self._give_results(self._watch.look(self._status, self.clock.now()))
        self._status["state"] = colour(self._status, self._watch.troubles)
        self._status["reasons"] = [trouble.statement for trouble in self._watch.troubles]
        self._status["alarms"] = [asdict(a) for a in self._active.values()]
        for sink in self._sinks.values():
            sink.health(self._status)
        if self._recorder is not None:
            self._recorder.health(self._status["time"], self._status)
        self.on_health(self._status)

    def _measure(self) -> dict[str, Any]:
        sources = {name: source.status() for name, source in self._sources.items()}
        stages = {name: figures for worker in self._workers for name, figures in worker.status().items()}
        sinks = {name: sink.status() for name, sink in self._sinks.items()}
        return {
            "site": self.site,
            "cell": self.cell,
            "session": self.session,
            "time": self.clock.now(),
            "utc_error_ms": round(self.clock.utc_error_ns * 1e-6, 3),
            "loop_lag_ms": round(1e3 * self._lag, 3),
            "sources": sources,
            "frames": {"count": self._frames, "streams": alignment(self._aligner)},
            "stages": stages,
            "results": self._results,
            "sinks": sinks,
            "recorder": self._recorder.stats() if self._recorder is not None else None,
        }

    # what sinks may ask (cellwatt.sink.CellView) -----------------------------------------------------

    def status(self) -> Mapping[str, Any]:
        """See ``CellView.status``."""
        return self._status

    def config(self) -> Mapping[str, Any]:
        """See ``CellView.config``."""
        return public_config(self._config)

    def schema(self) -> Mapping[str, Any]:
        """See ``CellView.schema``."""
        return describe(self._aligner.layout, {n: s.driver.streams for n, s in self._sources.items()})

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        """See ``CellView.recordings``."""
        return self._history.recordings() if self._history is not None else ()

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        """See ``CellView.history``."""
        if self._history is None:
            return ()
        return self._history.history(source, stream, session, first, count)

    # reload ---------------------------------------------------------------------------------------

    async def reload(self, config: CellConfig) -> str:
        """Apply what changed and nothing else; gives a line that says what was done.

        Raises ``CellwattError`` for changes that need a restart (site, cell, record), ``ConfigError`` where a part
        cannot be made; nothing is changed then.
        """
        async with self._changing:
            if self._stopping.is_set():
                raise CellwattError("the cell is being stopped; nothing was changed")
            return await self._change(config)

    async def _change(self, config: CellConfig) -> str:
        old = self._config
        fixed = [k for k in ("site", "cell", "record") if getattr(old, k) != getattr(config, k)]
        if fixed:
            raise CellwattError(f"a change of {', '.join(fixed)} needs a restart; nothing was changed")
        sources = changed(old.sources, config.sources)
        sinks = changed(old.sinks, config.sinks)
        stages = changed(old.stages, config.stages)
        again = bool(sources or stages or old.frames != config.frames or old.robot != config.robot)
        if not (again or sinks):
            self._config = config
            return "nothing changed"
        prepared = await asyncio.to_thread(prepare, config)
        await self._end(f"source {n}" for n in sources)
        await self._end(f"sink {n}" for n in sinks)
        if again:
            self._flush()
            await self._end_workers()
            self._flush()  # what sources that stay gave meanwhile
        self._config = config
        for name in sources:
            if name in config.sources:
                self._start_source(config.sources[name])
            else:
                del self._sources[name]
        for name in sinks:
            self._sinks.pop(name, None)
            if name in config.sinks:
                self._start_sink(config.sinks[name])
        if again:
            self._build_frames(prepared)
            if self._recorder is not None:
                self._recorder.redeclare(self._header())
        parts = [f"source {n}" for n in sources] + [f"sink {n}" for n in sinks] + [f"stage {n}" for n in stages]
        done = "reloaded: " + (", ".join(parts) or "frames")
        self._tell(Event(self.clock.now(), None, "reloaded", done))
        return done


def changed(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Names that were added, removed or differ."""
    return [n for n in dict.fromkeys([*old, *new]) if old.get(n) != new.get(n)]
