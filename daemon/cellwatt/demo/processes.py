"""The daemon and the subscriber of the demo, each in its own process."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

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
    with log_of(folder).open("wb") as log:
        async with _running("run", str(file), env=environment, stderr=log) as process:
            yield process


@contextlib.asynccontextmanager
async def subscriber(endpoint: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run ``cellwatt watch`` on the demo's cell, with its messages as JSON lines on standard output."""
    words = ["watch", "--json", "--connect", f"tcp/{endpoint}", "--patience", f"{START:.0f}", "--site", "demo"]
    words += ["--cell", "demo", *(word for topic in TOPICS for word in ("--topic", topic))]
    async with _running(*words, stdout=asyncio.subprocess.PIPE, limit=LONGEST) as process:
        keep_up(process.pid)  # it shares the cores with the devices whose samples it counts
        yield process


def log_of(folder: Path) -> Path:
    """Path of the daemon's log."""
    return folder / "daemon.log"


@contextlib.asynccontextmanager
async def _running(*words: str, **how: Any) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run a command; the block stops it unless the block fails. Kills it if it is still running after the block."""
    command = (*MODULE, "cellwatt.commands", *words)
    process = await asyncio.create_subprocess_exec(*command, preexec_fn=ends_with_parent(), **how)
    try:
        yield process
    except BaseException:
        if process.returncode is None:
            process.terminate()
        raise
    finally:
        await ended(process, _PATIENCE)
