"""The ur-rtde library as the client: newest state only, in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from asyncio.subprocess import PIPE, Process

from cellwatt.errors import ConnectError, ProtocolError
from cellwatt_drivers.ur import receive, wire
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection

CHUNK = 1 << 16
START_TIME = 10.0
"""Seconds, at the least, that the process has from its start to the first package."""


def unreadable(selection: Selection) -> list[str]:
    """Fields that the library has no method for."""
    return [f.name for f in selection.fields if f.name not in receive.GETTERS]


async def stream(host: str, rate: float, selection: Selection, intake: Intake, timeout: float) -> None:
    """Feed the intake from the library until it fails (``SourceError``)."""
    names = [f.name for f in selection.fields]
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        receive.__name__,
        host,
        f"{rate:g}",
        *names,
        stdout=PIPE,
        stderr=PIPE,
        limit=CHUNK,
        start_new_session=True,  # a Ctrl-C is for the daemon, which ends it
    )
    try:
        await _pass_on(child, f"{host} (ur_rtde)", selection, intake, timeout)
    finally:
        if child.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
        await child.wait()


async def _pass_on(child: Process, where: str, selection: Selection, intake: Intake, timeout: float) -> None:
    assert child.stdout is not None and child.stderr is not None
    types = ["DOUBLE", *(_doubles(f.width) for f in selection.fields)]
    decoder = Decoder(selection, receive.RECIPE, types)
    rest = b""
    patience = max(timeout, START_TIME)
    while True:
        try:
            async with asyncio.timeout(patience):
                chunk = await child.stdout.read(CHUNK)
        except TimeoutError as error:
            raise ConnectError(f"{where}: no data for {patience:g} s") from error
        if not chunk:
            said = (await child.stderr.read()).decode(errors="replace").strip().splitlines()
            await child.wait()
            raise ConnectError(f"{where}: {said[-1] if said else 'the library ended'}")
        patience = timeout
        rest += chunk
        end = 0
        for item, used in wire.scan(memoryview(rest), wire.FROM_CONTROLLER, decoder.package):
            if not isinstance(item, wire.Run):
                raise ProtocolError(f"{where}: {item.kind.name} from the library's process")
            intake.take(*decoder.decode(item.data, item.count))
            end = used
        rest = rest[end:]


def _doubles(width: int) -> str:
    return {1: "DOUBLE", 3: "VECTOR3D", 6: "VECTOR6D"}[width]
