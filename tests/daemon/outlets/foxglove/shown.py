"""A cell on the bus and ``serve`` beside it, as a process."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from cellwatt import Frames
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from tests.daemon.outlets.foxglove.client import Client
from tests.daemon.outlets.zenoh.fake_cell import FakeView
from tests.daemon.outlets.zenoh.processes import ROOT, free_port
from tests.daemon.outlets.zenoh.serving import serving
from tests.patience import PATIENCE, eventually


@dataclass
class Shown:
    """The cell's ``outlet``; the ``port`` of the Foxglove server; how many frames were told until it served."""

    outlet: ZenohOutlet
    port: int
    process: asyncio.subprocess.Process
    begun: int

    async def end(self) -> tuple[int, list[str], str]:
        """Exit code, lines and errors after Ctrl-C."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        out, err = await asyncio.wait_for(self.process.communicate(), PATIENCE)
        assert self.process.returncode is not None
        return self.process.returncode, out.decode().splitlines(), err.decode()


@asynccontextmanager
async def shown(frames: Callable[[int, int], Frames] | None = None, *, port: int = 0) -> AsyncIterator[Shown]:
    """A cell that is served on ``port`` (0: a free one); ends the server if the test has not.

    It tells ``frames(first, count)`` one by one until it is served.
    """
    bus = free_port()
    settings = ZenohSettings(listen=(f"tcp/127.0.0.1:{bus}",))
    async with serving(ZenohOutlet("zenoh", settings, FakeView())) as outlet:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "tests.daemon.outlets.foxglove.serve_process", str(bus), str(port)),
            cwd=ROOT,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            assert process.stdout is not None
            line = asyncio.create_task(process.stdout.readline())
            begun = await _until(line, outlet, frames, 0)
            said = line.result().decode()
            assert said.startswith("Foxglove: open a connection to ws://127.0.0.1:"), said
            cell = Shown(outlet, int(said.rsplit(":", 1)[1]), process, begun)
            if frames is not None:  # if it did not wait for them, it starts anew with the first
                cell.begun = await _until(asyncio.create_task(_framed(cell.port)), outlet, frames, begun)
            yield cell
        finally:
            if process.returncode is None:
                process.kill()
                await process.communicate()


async def _until(
    done: asyncio.Task[Any], outlet: ZenohOutlet, frames: Callable[[int, int], Frames] | None, begun: int
) -> int:
    """Tell frames until something is done; their number."""
    end = time.monotonic() + PATIENCE
    while not done.done():
        assert time.monotonic() < end, "the server did not begin"
        if frames is not None:
            outlet.offer(frames(begun, 1))
            begun += 1
        await asyncio.wait([done], timeout=0.02)
    return begun


async def _framed(port: int) -> None:
    """Return once a client is offered frames."""
    while True:
        async with Client(port) as client:
            await eventually(lambda: client.channels or client.ended, "topics")
            if "/frame" in client.channels:
                return
