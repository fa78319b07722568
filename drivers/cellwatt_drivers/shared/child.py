"""A vendor's library in a process of its own, for one whose calls hold the GIL or may block for ever.

The child is a module of the driver, run as a script: the driver's package is not imported there. It writes its data
to standard output and, when the library fails, a line to standard error.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Callable
from types import ModuleType

from cellwatt.child import ends_with_parent
from cellwatt.errors import ConnectError, SourceError

_CHUNK = 1 << 16
_START_TIME = 10.0
"""s, at the least, that the child has from its start to its first data."""


class Child:
    """A running child; ``reading`` makes it."""

    def __init__(self, process: Process, where: str, timeout: float, hint: str) -> None:
        self.pid = process.pid
        self._process = process
        self._where = where
        self._timeout = timeout
        self._patience = max(timeout, _START_TIME)
        self._hint = hint

    async def chunk(self, failure: Callable[[str], SourceError]) -> bytes:
        """Return the data that came next.

        Raises ``ConnectError`` after ``timeout`` s without any, and, at the child's end, what ``failure`` makes of the
        last line of its standard error (empty where there is none).
        """
        process, patience = self._process, self._patience
        assert process.stdout is not None and process.stderr is not None
        try:
            async with asyncio.timeout(patience):
                chunk = await process.stdout.read(_CHUNK)
        except TimeoutError:
            raise ConnectError(f"{self._where}: no data for {patience:g} s{self._hint}") from None
        if not chunk:
            said = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
            await process.wait()
            raise failure(said[-1] if said else "")
        self._patience = self._timeout
        return chunk


@contextlib.asynccontextmanager
async def reading(
    module: ModuleType, *arguments: str, where: str, timeout: float, hint: str = ""
) -> AsyncIterator[Child]:
    """Run a module as a script and read what it writes; ``where`` begins the texts of errors, ``hint`` ends them."""
    assert module.__file__ is not None
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-P",  # no module of the driver's folder hides one of the library's
        module.__file__,
        *arguments,
        stdout=PIPE,
        stderr=PIPE,
        limit=_CHUNK,
        preexec_fn=ends_with_parent(signal.SIGKILL),
    )
    try:
        yield Child(process, where, timeout, hint)
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
        await process.wait()


def take_stdout() -> int:
    """Return a descriptor of standard output for data; what the library prints goes to standard error from now on."""
    data = os.dup(1)
    os.dup2(2, 1)
    return data


def write_all(descriptor: int, data: bytes) -> None:
    """Write all bytes, however long that blocks."""
    while data:
        data = data[os.write(descriptor, data) :]
