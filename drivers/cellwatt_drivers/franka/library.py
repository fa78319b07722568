"""pylibfranka as the client, in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncGenerator

import numpy as np

from cellwatt.errors import ConnectError, DeviceError, SourceError, WrongDeviceError
from cellwatt_drivers.franka import receive
from cellwatt_drivers.franka.fields import Selection
from cellwatt_drivers.franka.intake import Float

_CHUNK = 1 << 18
_START_TIME = 10.0
"""s, at the least, that the process has from its start to the first state."""


async def states(host: str, every: int, selection: Selection, timeout: float) -> AsyncGenerator[Float, None]:
    """Blocks (n, 1 + channels) of states, the robot's time in ms first, until it fails (``SourceError``)."""
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
    )
    try:
        async for block in _blocks(child, host, selection, timeout):
            yield block
    finally:
        with contextlib.suppress(ProcessLookupError):
            child.kill()
        await child.wait()


async def _blocks(child: Process, host: str, selection: Selection, timeout: float) -> AsyncGenerator[Float, None]:
    assert child.stdout is not None and child.stderr is not None
    columns = np.concatenate([[0], 1 + selection.columns])
    size = 8 * (1 + selection.width)
    patience = max(timeout, _START_TIME)
    rest = b""
    while True:
        try:
            async with asyncio.timeout(patience):
                chunk = await child.stdout.read(_CHUNK)
        except TimeoutError:
            raise ConnectError(f"{host}: no state for {patience:g} s; check the address, and that FCI is on") from None
        if not chunk:
            raise _failure(host, (await child.stderr.read()).decode(errors="replace"))
        rest += chunk
        whole = len(rest) // size * size
        if whole:
            patience = timeout
            rows = np.frombuffer(rest[:whole], dtype="<f8").reshape(-1, 1 + selection.width)
            rest = rest[whole:]
            yield rows[:, columns]


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
