"""A whole cell in one process: the parts of the daemon on one event loop, so that a test can hold each by the hand."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

from cellwatt.align import Aligner
from cellwatt.clock.cell import CellClock
from cellwatt.config import CellConfig
from cellwatt.frames import Frames
from cellwatt.results import Event, Result
from cellwatt.runtime.assemble import Prepared, prepare
from cellwatt.runtime.chain import BEGINS_ANEW, Chain
from cellwatt.runtime.change import Change
from cellwatt.runtime.collector import Collector, Entry, load_libraries
from cellwatt.runtime.tasks import Tasks, plain_errors
from cellwatt.runtime.teller import Teller
from cellwatt.ticker import Ticker

HEALTH_RATE = 1.0  # Hz


class Worker:
    """Feeds a chain block by block in a thread; ``take`` gets its results on the event loop."""

    def __init__(self, chain: Chain, take: Callable[[Sequence[Result]], None]) -> None:
        self.chain = chain
        self._take = take
        self._queue: asyncio.Queue[Frames | None] = asyncio.Queue()
        self._thread = ThreadPoolExecutor(1)
        self.ended = asyncio.Event()

    def offer(self, frames: Frames | None) -> None:
        """Take one block; None ends ``run`` when all before it is done."""
        self._queue.put_nowait(frames)

    async def run(self) -> None:
        """Process what comes until the end, then close the chain."""
        loop = asyncio.get_running_loop()
        try:
            while (frames := await self._queue.get()) is not None:
                self._take(await loop.run_in_executor(self._thread, self.chain.process, frames))
            self._take(await loop.run_in_executor(self._thread, self.chain.close))
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)
            self.ended.set()


class Cell:
    """A cell on one event loop. ``run`` serves until ``stop``; ``reload`` applies what changed in the settings."""

    def __init__(self, config: CellConfig) -> None:
        self._config = config
        self.clock = CellClock()
        self.session = self.clock.now()
        self.view = Teller(config, self.session, self.clock.now)
        self._collector = Collector(config, self.clock, self._take)
        self._aligner = Aligner({}, config.frames.rate, config.frames.latency)
        self._lag = 0.0
        self._stopping = asyncio.Event()
        self._workers: list[Worker] = []

    async def run(self, ready: Callable[[], None] = lambda: None) -> None:
        """Serve until ``stop``; then drain and close. ``ready`` is called once everything is started."""
        with plain_errors():
            await self._serve(ready)

    def stop(self) -> None:
        """End ``run`` in order: sources first, then what is queued, then the record."""
        self._stopping.set()

    def _take(self, entry: Entry) -> None:
        self.view.take(entry)
        if not isinstance(entry, Event):
            self._give_frames(self._aligner.add(entry))

    async def _heart(self) -> None:
        async with Ticker(HEALTH_RATE) as ticker:
            async for tick in ticker:
                self._lag = tick.lateness
                self._collector.keep_time()
                self._look()

    async def _serve(self, ready: Callable[[], None]) -> None:
        async with asyncio.TaskGroup() as group:
            self._tasks = Tasks(group)
            prepared = await asyncio.to_thread(prepare, self._config)
            load_libraries(self._config)
            await self.view.start(self._tasks, prepared.streams, prepared.layout)
            await self._tasks.end(["warnings"])  # a loop that skips waits would skip its hour before the heart beats
            self._collector.start(self._tasks)
            self._begin_frames(prepared)
            heart = group.create_task(self._heart(), name="heart")
            self._look()
            ready()
            await self._stopping.wait()
            await self._collector.close(self._tasks)
            await self._end_frames()
            self._look()
            await self.view.close(self._tasks)
            heart.cancel()

    def _give_frames(self, blocks: Iterable[Frames]) -> None:
        for frames in blocks:
            self.view.take(frames)
            for worker in self._workers:
                worker.offer(frames)

    def _give_results(self, results: Sequence[Result]) -> None:
        for result in results:
            self.view.take(result)

    def _begin_frames(self, prepared: Prepared) -> None:
        grid, before = self._config.frames, self._aligner
        self._aligner = Aligner(
            prepared.streams, grid.rate, grid.latency, sequence=before.sequence, after=before.reached
        )
        for chain in prepared.chains:
            self.view.withdraw(chain.names, BEGINS_ANEW)
            worker = Worker(chain, self._give_results)
            self._workers.append(worker)
            self._tasks.spawn(f"stages {'+'.join(chain.names)}", worker.run())

    async def _end_frames(self) -> None:
        self._give_frames(self._aligner.flush())
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.offer(None)
        await asyncio.gather(*(worker.ended.wait() for worker in workers))
        self._give_frames(self._aligner.flush())  # what sources that stay gave meanwhile

    def _look(self) -> None:
        self.view.look(
            {
                "utc_error_ms": round(self.clock.utc_error_ns * 1e-6, 3),
                "loop_lag_ms": round(1e3 * self._lag, 3),
                "sources": self._collector.status(),
                "frames": self._aligner.status(),
                "stages": {name: told for w in self._workers for name, told in w.chain.status().items()},
            }
        )

    async def reload(self, config: CellConfig) -> str:
        """Apply what changed and nothing else; gives a line that says what was done."""
        change = Change.between(self._config, config)
        prepared = await asyncio.to_thread(prepare, config)
        await self._collector.stop(self._tasks, change.sources)
        await self.view.stop(self._tasks, change.outlets)
        if change.frames:
            await self._end_frames()
        self._config = config
        self._collector.change(self._tasks, config, change.sources)
        self.view.change(self._tasks, config, change.outlets)
        if change.frames:
            self._begin_frames(prepared)
            self.view.redeclare(prepared.streams, prepared.layout)
        self.view.take(Event(self.clock.now(), None, "reloaded", str(change)))
        return str(change)
