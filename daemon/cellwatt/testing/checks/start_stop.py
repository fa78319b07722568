"""A driver starts, identifies the device, delivers, stops, and can do so again."""

from __future__ import annotations

import asyncio
import os
import re
from pathlib import Path
from typing import Any

from cellwatt.driver import Driver, Identity
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import NotConformingError, Rig, require
from cellwatt.testing.running import ended, running

_NAME = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)*")
_SAMPLES = 10


async def starts_and_stops(rig: Rig, folder: Path) -> None:
    """Also require a description, valid streams, and no file, socket or task left at the end."""
    describes_itself(rig.driver)
    async with EmulatedDevice(rig, folder) as device:
        declares_streams(rig.make(device.address, CollectingInlet()))
        await _identifies(rig, device.address)
        await _session(rig, device.address)  # files that a library opens permanently are open from here on
        files, tasks = _open_files(), len(asyncio.all_tasks())
        for _ in range(2):
            await _session(rig, device.address)
        await _lets_go(files, tasks, rig.patience)


def describes_itself(driver: type[Driver[Any]]) -> None:
    """Require the texts that ``cellwatt drivers NAME`` shows."""
    require(getattr(driver, "title", ""), f"{driver.__name__}.title: one line about the device is missing")
    writes = getattr(driver, "writes", None)
    require(
        isinstance(writes, tuple) and all(isinstance(w, str) and w for w in writes),
        f"{driver.__name__}.writes: found {writes!r}, expected a tuple of texts, one for each kind of bytes that may "
        "be sent to the device; () if none",
    )


def declares_streams(driver: Driver[Any]) -> None:
    """Require streams without the device, with distinct and well-formed names."""
    streams = driver.streams
    require(streams, "streams is empty: it must be known from the settings alone")
    names = [s.name for s in streams]
    require(len(set(names)) == len(names), f"two streams have the same name: {', '.join(names)}")
    channels = [c.name for s in streams for c in s.channels]
    for name in [*names, *channels]:
        require(_NAME.fullmatch(name), f"{name!r}: expected small letters, digits, '_' and dots, like supply.power")
    twice = sorted({c for c in channels if channels.count(c) > 1})
    require(not twice, f"channels declared more than once: {', '.join(twice)}")
    for stream in streams:
        require(stream.channels, f"stream {stream.name} has no channels")


async def _identifies(rig: Rig, address: str) -> None:
    driver = rig.make(address, CollectingInlet())
    try:
        async with asyncio.timeout(rig.patience):
            identity = await driver.identify()
    except Exception as error:
        raise NotConformingError(f"identify() failed: {type(error).__name__}: {error}") from error
    require(isinstance(identity, Identity) and identity.model, f"identify() returned {identity!r}: name the model")


async def _session(rig: Rig, address: str) -> None:
    async with running(rig, address) as source:
        for again in (False, True):
            await source.samples(_SAMPLES, "after the start" + " of the same driver again" * again)
            if not again:
                await ended(source.task, rig.patience)
                await _is_quiet(source.inlet)
                source.start()
        require(source.inlet.identities, "inlet.connected(identity) was never called")
        inlet = source.inlet
    await _is_quiet(inlet)


async def _is_quiet(inlet: CollectingInlet) -> None:
    """Require that a cancelled driver emits nothing more."""
    before = inlet.samples
    await asyncio.sleep(0.05)
    require(inlet.samples == before, "readings arrived after run() had been cancelled")


def _open_files() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - an iterator over the folder would itself hold a descriptor


async def _lets_go(files: int, tasks: int, patience: float) -> None:
    """Require that tasks and sockets are closed; this takes some turns of two loops."""
    loop = asyncio.get_running_loop()
    end = loop.time() + patience / 4
    # Something else in this process may open a file for a moment: the look that ends the wait also decides.
    while (left := _open_files() - files) > 0 or len(asyncio.all_tasks()) > tasks:
        if loop.time() >= end:
            break
        await asyncio.sleep(0.02)
    running_tasks = [t.get_coro() for t in asyncio.all_tasks() if t is not asyncio.current_task()]
    require(len(running_tasks) < tasks, f"tasks still run after run() was cancelled: {running_tasks}")
    require(left <= 0, f"{left} files or sockets stay open after run() was cancelled")
