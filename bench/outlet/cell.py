"""An emulated UR and a power board, as the sources of a cell."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from cellwatt.emulation import EmulatorProcess

SITE, CELL = "bench", "cell"
ARM = {"arm": ("ur", {"rate": "500 Hz"}, "127.0.0.1:0"), "board": ("power_board", {}, "pty")}
"""Driver, settings, and where its emulator listens, by source."""


@asynccontextmanager
async def emulated() -> AsyncIterator[dict[str, dict[str, Any]]]:
    """The devices as processes; gives the sources of the settings."""
    async with AsyncExitStack() as stack:
        sources = {}
        for name, (driver, settings, listen) in ARM.items():
            emulator = await stack.enter_async_context(EmulatorProcess(driver, "--listen", listen))
            emulator.be_punctual()
            host, _, port = emulator.address.rpartition(":")
            place = {"port": emulator.address} if listen == "pty" else {"host": host, "port": int(port)}
            sources[name] = {"driver": driver, **place, **settings}
        yield sources
