"""A sink that serves while a test runs, with a heartbeat."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from cellwatt.publish.sink import ZenohSink


@asynccontextmanager
async def serving(sink: ZenohSink) -> AsyncIterator[ZenohSink]:
    """Run a sink and give it the cell's health ten times a second."""

    async def beat() -> None:
        while True:
            sink.health({"state": "green"})
            await asyncio.sleep(0.1)

    running = asyncio.create_task(sink.run())
    beating = asyncio.create_task(beat())
    try:
        yield sink
    finally:
        for task in (beating, running):
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
