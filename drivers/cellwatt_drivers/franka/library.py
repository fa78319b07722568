"""pylibfranka as the client, in its own process: its reads hold the GIL and may block for ever."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator

import numpy as np

from cellwatt.arrays import Float
from cellwatt.child import ended, ends_with_parent
from cellwatt.errors import ConnectError, DeviceError, SourceError, WrongDeviceError, why
from cellwatt_drivers.franka import receive
from cellwatt_drivers.franka.fields import Selection

_CHUNK = 1 << 16
_START_TIME = 10.0
"""Shortest time limit for the library from its start to its first state, s."""


class Reader:
    """The library's process and the states of one robot; see ``reading``."""

    def __init__(self, process: Process, host: str, selection: Selection, timeout: float) -> None:
        self._process = process
        self._host = host
        self._timeout = timeout
        self._patience = max(timeout, _START_TIME)
        self._columns = np.concatenate([[0, 1], 2 + selection.columns])
        self._width = 2 + selection.width
        self._rest = b""

    @property
    def real_time(self) -> bool:
        """True if the system granted it real-time priority: without it, a busy PC loses states."""
        try:
            return os.sched_getscheduler(self._process.pid) == os.SCHED_FIFO
        except OSError:  # the process has just ended, or the call is not permitted
            return False

    async def block(self) -> Float:
        """Return the received states (n, 2 + channels): the robot's time, ms, the reader's delay, ms, and the values.

        Raises ``ConnectError`` after ``timeout`` s without a state, and the library's error when the process ends.
        """
        size = 8 * self._width
        while len(self._rest) < size:
            self._rest += await self._chunk()
        whole = len(self._rest) // size * size
        rows = np.frombuffer(self._rest[:whole], dtype="<f8").reshape(-1, self._width)
        self._rest = self._rest[whole:]
        return rows[:, self._columns]

    async def _chunk(self) -> bytes:
        process, patience = self._process, self._patience
        assert process.stdout is not None and process.stderr is not None
        try:
            async with asyncio.timeout(patience):
                chunk = await process.stdout.read(_CHUNK)
        except TimeoutError:
            raise ConnectError(
                f"{self._host}: no data for {patience:g} s; check the address, and that FCI is on"
            ) from None
        if not chunk:
            output = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
            await process.wait()
            raise self._failure(output[-1] if output else "the library ended")
        self._patience = self._timeout
        return chunk

    def _failure(self, output: str) -> SourceError:
        """Return the error for the library's last line of output."""
        host = self._host
        kind, _, text = output.partition(": ")
        if "version" in text.lower() and "incompatible" in text.lower():
            return WrongDeviceError(
                f"{host}: {text}; install the pylibfranka that fits the robot's system image (Franka's compatibility "
                "table)"
            )
        if kind == "NetworkException":
            advice = "check the address, that FCI is on, that no other client has it, and that no firewall blocks UDP"
            return ConnectError(f"{host}: {text}; {advice}")
        return DeviceError(f"{host}: {kind}: {text}" if text else f"{host}: {kind}")


@contextlib.asynccontextmanager
async def reading(host: str, every: int, selection: Selection, timeout: float) -> AsyncIterator[Reader]:
    """Run the library; it returns the states whose time in ms is a multiple of ``every``."""
    arguments = (receive.__file__, host, str(every), *selection.attributes)
    try:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",  # no module of this folder may shadow one of the library's
            *arguments,
            stdout=PIPE,
            stderr=PIPE,
            limit=_CHUNK,
            preexec_fn=ends_with_parent(signal.SIGKILL),
        )
    except OSError as error:
        raise ConnectError(f"{host}: the library cannot be started: {why(error)}") from error
    try:
        yield Reader(process, host, selection, timeout)
    finally:
        await ended(process, 0.0)
