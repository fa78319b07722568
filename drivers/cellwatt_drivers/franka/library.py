"""pylibfranka as the client, in a process of its own."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncIterator

import numpy as np

from cellwatt.batch import Float
from cellwatt.errors import ConnectError, DeviceError, SourceError, WrongDeviceError
from cellwatt_drivers.franka import receive
from cellwatt_drivers.franka.fields import Selection
from cellwatt_drivers.shared import child
from cellwatt_drivers.shared.child import Child


class Reader:
    """The library's process with one robot's states; see ``reading``."""

    def __init__(self, process: Child, host: str, selection: Selection) -> None:
        self._child = process
        self._host = host
        self._columns = np.concatenate([[0, 1], 2 + selection.columns])
        self._width = 2 + selection.width
        self._rest = b""

    @property
    def real_time(self) -> bool:
        """True if the system gave it real-time priority: without it, a busy PC loses states."""
        try:
            return os.sched_getscheduler(self._child.pid) == os.SCHED_FIFO
        except OSError:  # it just ended, or nobody may ask
            return False

    async def block(self) -> Float:
        """Return the states (n, 2 + channels) that came; first the robot's time, then how long the reader was kept, ms.

        Raises ``SourceError``.
        """
        size = 8 * self._width
        while len(self._rest) < size:
            self._rest += await self._child.chunk(self._failure)
        whole = len(self._rest) // size * size
        rows = np.frombuffer(self._rest[:whole], dtype="<f8").reshape(-1, self._width)
        self._rest = self._rest[whole:]
        return rows[:, self._columns]

    def _failure(self, said: str) -> SourceError:
        """Return the error that the library's last words mean."""
        host = self._host
        kind, _, text = (said or "the library ended").partition(": ")
        if "version" in text.lower() and "incompatible" in text.lower():
            return WrongDeviceError(
                f"{host}: {text}; install the pylibfranka that fits the robot's system image (Franka's compatibility "
                "table)"
            )
        if kind == "NetworkException":
            return ConnectError(f"{host}: {text}; check the address, that FCI is on, and that no other client has it")
        return DeviceError(f"{host}: {kind}: {text}" if text else f"{host}: {kind}")


@contextlib.asynccontextmanager
async def reading(host: str, every: int, selection: Selection, timeout: float) -> AsyncIterator[Reader]:
    """Run the library; of all states those count whose time in ms is a whole multiple of ``every``."""
    arguments = (host, str(every), *selection.attributes)
    hint = "; check the address, and that FCI is on"
    async with child.reading(receive, *arguments, where=host, timeout=timeout, hint=hint) as process:
        yield Reader(process, host, selection)
