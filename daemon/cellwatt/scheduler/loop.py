"""The event loop of dask's client, in a thread that ends when it is told to."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from threading import Event, Thread
from typing import Any

from tornado.ioloop import IOLoop

from cellwatt.scheduler.quiet import distributed


@contextmanager
def event_loop() -> Iterator[IOLoop]:
    """An event loop that runs in a thread of its own, with all that was left on it cancelled at the end.

    Processes that are started from it take no SIGINT: a Ctrl-C is for the command, which ends them in order.
    """
    serving = _Serving()
    resource_tracker.ensure_running()  # else the thread would start it, and take SIGINT from then on
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        serving.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    serving.begun.wait()
    try:
        yield serving.io
    finally:
        serving.io.asyncio_loop.call_soon_threadsafe(serving.over.set)  # type: ignore[attr-defined]
        serving.join()
        _end_offload()


class _Serving(Thread):
    def __init__(self) -> None:
        super().__init__(name="dask", daemon=True)
        self.begun = Event()

    def run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self.io, self.over = IOLoop.current(), asyncio.Event()
        self.begun.set()
        await self.over.wait()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)


def _end_offload() -> None:
    """End the thread in which distributed unpacks messages; it gets a new one if it is used again."""
    used: Any = distributed.utils._offload_executor
    distributed.utils._offload_executor = ThreadPoolExecutor(1, "Dask-Offload")
    used.shutdown()
