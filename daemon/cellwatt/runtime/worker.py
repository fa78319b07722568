"""A chain of stages in a thread of its own, behind a bounded queue."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from cellwatt.bounded import BoundedQueue, QueueClosedError
from cellwatt.frames import Frames
from cellwatt.results import Result
from cellwatt.runtime.chain import Chain

QUEUED_FRAMES = 500
"""Frames that may wait in front of a chain (10 s at 50 Hz); then the oldest are dropped and counted."""


class Worker:
    """Feeds a chain block by block; ``take`` gets its results on the event loop."""

    def __init__(self, chain: Chain, take: Callable[[Sequence[Result]], None]) -> None:
        self.chain = chain
        self._take = take
        self.dropped: Counter[str] = Counter()
        self._queue: BoundedQueue[Frames] = BoundedQueue(QUEUED_FRAMES, on_drop=self._count)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=f"stages {'+'.join(chain.names)}")

    def offer(self, frames: Frames) -> None:
        """Take one block; never blocks."""
        self._queue.put_nowait(frames, len(frames))

    async def run(self) -> None:
        """Process until the queue is closed and empty, then close the chain."""
        loop = asyncio.get_running_loop()
        try:
            with contextlib.suppress(QueueClosedError):
                while True:
                    frames = await self._queue.get()
                    self._take(await loop.run_in_executor(self._thread, self.chain.process, frames))
            self._take(await loop.run_in_executor(self._thread, self.chain.close))
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def finish(self) -> None:
        """No more frames will come; ``run`` ends when those waiting are done."""
        self._queue.close()

    def status(self) -> dict[str, Any]:
        """Figures of its stages, JSON-ready."""
        return {
            name: figures | {"dropped": self.dropped["frames"], "waiting": len(self._queue)}
            for name, figures in self.chain.status().items()
        }

    def _count(self, frames: Frames) -> None:
        self.dropped["frames"] += len(frames)
