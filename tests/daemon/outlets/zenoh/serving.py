"""An outlet that serves while a test runs, with a heartbeat."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from cellwatt.outlets.zenoh.outlet import ZenohOutlet


@asynccontextmanager
async def serving(outlet: ZenohOutlet) -> AsyncIterator[ZenohOutlet]:
    """Run an outlet and give it the cell's health ten times a second."""

    async def beat() -> None:
        while True:
            outlet.health({"state": "green"})
            await asyncio.sleep(0.1)

    running = asyncio.create_task(outlet.run())
    beating = asyncio.create_task(beat())
    try:
        yield outlet
    finally:
        for task in (beating, running):
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
