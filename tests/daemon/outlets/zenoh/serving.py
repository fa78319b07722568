"""An outlet that serves while a test runs, with a heartbeat."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from cellwatt.outlets.zenoh.outlet import ZenohOutlet
from tests.doing import doing
from tests.patience import eventually


async def opened(outlet: ZenohOutlet) -> None:
    """Until the outlet publishes: what it is given before is not published."""
    await eventually(lambda: outlet._publisher, "a session")


@asynccontextmanager
async def serving(outlet: ZenohOutlet, told: Mapping[str, Any] | None = None) -> AsyncIterator[ZenohOutlet]:
    """Run an outlet and give it the cell's health ten times a second."""

    async def beat() -> None:
        while True:
            outlet.health(told or {"state": "green"})
            await asyncio.sleep(0.1)

    async with doing(outlet.run(), beat()):
        await opened(outlet)
        yield outlet
