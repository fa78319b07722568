"""The process that serves for an outlet: begun with a socket to it, and ended in order."""

from __future__ import annotations

import asyncio
import contextlib
import resource
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

from cellwatt.child import ends_with_parent
from cellwatt.errors import OutletError

END: Final = 3.0
"""Longest time, s, for its end after its socket is closed, and again after it is told to end."""
LIMIT: Final = 2**20
"""Bytes that wait at either end of the socket before they are read."""


async def begin(
    module: str, what: str, memory: int
) -> tuple[asyncio.subprocess.Process, asyncio.StreamReader, asyncio.StreamWriter]:
    """Start ``python -m module FD`` with so many bytes of memory at most, and open what it is told through.

    Raises ``OutletError`` if that cannot be; ``what`` names it there.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        try:
            reader, writer = await asyncio.open_connection(sock=ours, limit=LIMIT)
        except BaseException:
            ours.close()
            raise
        try:
            return await _start(module, what, memory, theirs), reader, writer
        except BaseException:
            writer.close()
            raise


async def _start(module: str, what: str, memory: int, end: socket.socket) -> asyncio.subprocess.Process:
    try:
        return await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            module,
            str(end.fileno()),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            pass_fds=(end.fileno(),),
            preexec_fn=_bounded(memory),
        )
    except OSError as error:
        raise OutletError(f"{what} cannot be started: {error.strerror}") from error


def _bounded(memory: int) -> Callable[[], None]:
    tie = ends_with_parent(signal.SIGTERM)

    def begin() -> None:
        tie()
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))

    return begin


@asynccontextmanager
async def ending(
    process: asyncio.subprocess.Process, writer: asyncio.StreamWriter | None = None
) -> AsyncIterator[None]:
    """End the process afterwards: its socket is closed, if there is one, then it is told, then it is killed."""
    try:
        yield
    finally:
        ended = asyncio.ensure_future(process.wait())
        if writer is not None:
            writer.close()
            await asyncio.wait([ended], timeout=END)
        for end, patience in ((process.terminate, END), (process.kill, None)):
            if not ended.done():
                with contextlib.suppress(ProcessLookupError):
                    end()
                await asyncio.wait([ended], timeout=patience)


def end_of(process: asyncio.subprocess.Process) -> str:
    """How the process ended, in words."""
    code = process.returncode
    if code is not None and code < 0:
        return f"by {signal.Signals(-code).name}"
    return f"exit code {code}"
