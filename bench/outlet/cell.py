"""A cell with an emulated UR and a power board, and a whole daemon."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import yaml

from cellwatt.emulation import EmulatorProcess
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session

SITE, CELL = "bench", "cell"
PATIENCE = 60.0
"""s in which a link must come about."""
WARM_UP = 6.0
"""s from the start of a daemon to the first figure."""
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


@asynccontextmanager
async def daemon(folder: Path, settings: Mapping[str, Any]) -> AsyncIterator[None]:
    """A whole daemon of a cell, recorded into ``folder/record``, its motion cut into tasks."""
    usual = {
        "site": SITE,
        "cell": CELL,
        "frames": {"rate": "50 Hz", "latency": "100 ms"},
        "record": {"folder": str(folder / "record")},
        "stages": {"segment": {}},
    }
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(usual | dict(settings), sort_keys=False))
    with (folder / "log").open("w") as log:
        command = [sys.executable, "-m", "cellwatt.commands", "run", str(file)]
        process = await asyncio.create_subprocess_exec(*command, stderr=log)
        try:
            await asyncio.sleep(WARM_UP)
            if process.returncode is not None:
                raise RuntimeError((folder / "log").read_text())
            yield
        finally:
            if process.returncode is None:
                process.send_signal(signal.SIGTERM)
            await process.wait()


def status(endpoint: str) -> dict[str, Any]:
    """Health of the cell, asked for over Zenoh."""
    with open_session(LinkSettings(mode="client", connect=(endpoint,)), patience=PATIENCE) as session:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for reply in session.get(f"{CellKeys(SITE, CELL).root}/@/status", timeout=2.0):
                told = json.loads(reply.ok.payload.to_bytes()) if reply.ok is not None else {}
                health: dict[str, Any] = told.get("status", {})
                if "processes" in health:
                    return health
            time.sleep(0.2)
    raise RuntimeError(f"nobody answers at {endpoint}")
