"""pylibfranka as the client, in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator

import numpy as np

from cellwatt.errors import ConnectError, DeviceError, SourceError, WrongDeviceError
from cellwatt_drivers.franka import receive
from cellwatt_drivers.franka.fields import Selection
from cellwatt_drivers.franka.intake import Float

_CHUNK = 1 << 16
_START_TIME = 10.0
"""s, at the least, that the process has from its start to the first state."""


class Reader:
    """The library's process with one robot's states; see ``reading``."""

    def __init__(self, child: Process, host: str, selection: Selection, timeout: float) -> None:
        self._child = child
        self._host = host
        self._columns = np.concatenate([[0, 1], 2 + selection.columns])
        self._width = 2 + selection.width
        self._timeout = timeout
        self._patience = max(timeout, _START_TIME)
        self._rest = b""

    @property
    def real_time(self) -> bool:
        """Whether the system gave it real-time priority: without it, a busy PC loses states."""
        try:
            return os.sched_getscheduler(self._child.pid) == os.SCHED_FIFO
        except OSError:  # it just ended, or nobody may ask
            return False

    async def block(self) -> Float:
        """The states (n, 2 + channels) that came; first the robot's time, then how long its reader was kept, in ms.

        Raises ``SourceError``.
        """
        size = 8 * self._width
        while len(self._rest) < size:
            self._rest += await self._chunk()
        self._patience = self._timeout
        whole = len(self._rest) // size * size
        rows = np.frombuffer(self._rest[:whole], dtype="<f8").reshape(-1, self._width)
        self._rest = self._rest[whole:]
        return rows[:, self._columns]

    async def _chunk(self) -> bytes:
        child, patience = self._child, self._patience
        assert child.stdout is not None and child.stderr is not None
        try:
            async with asyncio.timeout(patience):
                chunk = await child.stdout.read(_CHUNK)
        except TimeoutError:
            raise ConnectError(
                f"{self._host}: no state for {patience:g} s; check the address, and that FCI is on"
            ) from None
        if not chunk:
            said = (await child.stderr.read()).decode(errors="replace")
            await child.wait()
            raise _failure(self._host, said)
        return chunk


@contextlib.asynccontextmanager
async def reading(host: str, every: int, selection: Selection, timeout: float) -> AsyncIterator[Reader]:
    """The library reading; of all states those whose time in ms is a whole multiple of ``every``."""
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        receive.__name__,
        host,
        str(every),
        *selection.attributes,
        stdout=PIPE,
        stderr=PIPE,
        limit=_CHUNK,
        start_new_session=True,  # a Ctrl-C is for the daemon, which ends it
    )
    try:
        yield Reader(child, host, selection, timeout)
    finally:
        if child.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
        await child.wait()


def _failure(host: str, said: str) -> SourceError:
    """What the library's last words mean."""
    lines = said.strip().splitlines()
    kind, _, text = (lines[-1] if lines else "the library ended").partition(": ")
    if "version" in text.lower() and "incompatible" in text.lower():
        return WrongDeviceError(
            f"{host}: {text}; install the pylibfranka that fits the robot's system image (Franka's compatibility table)"
        )
    if kind == "NetworkException":
        return ConnectError(f"{host}: {text}; check the address, that FCI is on, and that no other client has it")
    return DeviceError(f"{host}: {kind}: {text}" if text else f"{host}: {kind}")
