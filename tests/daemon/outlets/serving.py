"""An outlet with a process that serves, while a test runs."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import psutil

from cellwatt import OutletError
from cellwatt.outlets.apart.outlet import Apart
from tests.doing import doing
from tests.patience import eventually


@asynccontextmanager
async def serving(outlet: Apart[Any]) -> AsyncIterator[str]:
    """Its address, without a slash at the end."""
    async with doing(outlet.run(), allowed=(OutletError,)) as running:
        await eventually(lambda: outlet.url or running.done(), "the address")
        if running.done():
            running.result()
        yield str(outlet.url).rstrip("/")


def children(module: str) -> list[psutil.Process]:
    """Processes of this one that run a module."""
    return [child for child in psutil.Process().children() if module in child.cmdline()]
