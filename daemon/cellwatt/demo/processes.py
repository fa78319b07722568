"""The daemon and the subscriber of the demo, each in its own process."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from pathlib import Path

from cellwatt.child import MODULE, ended, ends_with_parent
from cellwatt.runtime.processes.rights import keep_up

START = 60.0
"""Longest time, s, until all processes run."""
_PATIENCE = 5.0  # s
LONGEST = 16_000_000
"""Longest line, bytes, of the subscriber: the health of a cell with many devices may exceed asyncio's default."""
TOPICS = ("raw", "frame", "interval", "task", "prediction", "alarm", "health")


@contextlib.asynccontextmanager
async def daemon(
    file: Path, folder: Path, environment: Mapping[str, str] | None = None
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run ``cellwatt run`` on a settings file, with the log ``daemon.log`` in the folder; killed if still running."""
    command = [*MODULE, "cellwatt.commands", "run", str(file)]
    with log_of(folder).open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            *command, env=environment, stderr=log, preexec_fn=ends_with_parent()
        )
    async with _ended(process):
        yield process


@contextlib.asynccontextmanager
async def subscriber(endpoint: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run ``cellwatt watch`` on the demo's cell, with its messages as JSON lines on standard output."""
    topics = [word for topic in TOPICS for word in ("--topic", topic)]
    command = [*MODULE, "cellwatt.commands", "watch", "--json", "--connect", f"tcp/{endpoint}"]
    command += ["--patience", f"{START:.0f}", "--site", "demo", "--cell", "demo", *topics]
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, limit=LONGEST, preexec_fn=ends_with_parent()
    )
    keep_up(process.pid)  # it shares the cores with the devices whose samples it counts
    async with _ended(process):
        yield process


def log_of(folder: Path) -> Path:
    """Path of the daemon's log."""
    return folder / "daemon.log"


@contextlib.asynccontextmanager
async def _ended(process: asyncio.subprocess.Process) -> AsyncIterator[None]:
    """Ensure that a process has ended after the block; the block stops it unless it fails. Kills it if necessary."""
    try:
        yield
    except BaseException:
        if process.returncode is None:
            process.terminate()
        raise
    finally:
        await ended(process, _PATIENCE)
