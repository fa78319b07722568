"""A driver can be cancelled at every await, and then releases the device."""

from __future__ import annotations

import asyncio
from pathlib import Path

from cellwatt.errors import SourceError
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import NotConformingError, Rig
from cellwatt.testing.running import ended, running

_TURNS = (0, 1, 2, 3, 5, 8, 13, 21)
"""Turns of the loop after which the start is cancelled."""


async def cancels_anywhere(rig: Rig, folder: Path) -> None:
    """Cancel at several times during the start and while samples arrive; a later run must work."""
    async with EmulatedDevice(rig, folder) as device:
        for turns in _TURNS:
            await _cut_short(rig, device.address, turns)
        async with running(rig, device.address) as source:
            await source.samples(10, "after runs that were cancelled while they started")


async def _cut_short(rig: Rig, address: str, turns: int) -> None:
    driver = rig.make(address, CollectingInlet())
    task = asyncio.create_task(driver.run())
    for _ in range(turns):
        await asyncio.sleep(0)
    if not task.done():
        await ended(task, rig.patience)
    elif not isinstance(error := task.exception(), SourceError):
        raise NotConformingError(f"run() ended by itself while it started: {error!r}") from error
