"""The outlet over OPC UA beside a plain server of asyncua with as many variables, each a process of its own.

One client of asyncua subscribes to all 60. ``at_50_hz``: rows at the usual rate of frames; ``as_fast``: 25 rows at a
time, the next once the client has the last; ``at_500_hz``: rows at the highest rate of frames, which is more than
either takes: the outlet drops, counted, what its queue has no room for, the plain server's writer is held up instead.
``lost`` is the share of the offered values that the client did not get, ``core_percent`` the processor time of the
process that serves until the last value came, ``us_a_value`` that of one received value. The outlet writes most values
twice, as joints have nodes of OPC UA for Robotics, too.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

import psutil

from cellwatt.outlets.opc_ua.outlet import OpcUaOutlet, OpcUaOutletSettings
from outlet.children import Child, child
from outlet.figures import Figures, computed, spread
from outlet.loop import off_loop, served, until
from outlet.opc_ua_plain import due
from outlet.rows import BLOCK, CHANNELS, RATE, View, frames

PACES = {"at_50_hz": RATE, "as_fast": 0.0, "at_500_hz": 500.0}
"""Rows a second; 0: the next once the client has the last."""
START = 60.0
"""s for the start of the outlet's process."""

Write = Callable[[float, int], Awaitable[Any]]
"""Has so many rows written at a rate, or for a rate of 0 without a pause."""


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of the outlet over OPC UA and of the plain server, taken in turn."""
    ways = {"cellwatt": ours, "plain": theirs}
    runs = [{name: asyncio.run(way(seconds)) for name, way in ways.items()} for _ in range(repeats)]
    return {f"{name}_{pace}": spread([run[name][pace] for run in runs]) for pace in PACES for name in ways}


async def ours(seconds: float) -> dict[str, dict[str, float]]:
    """Figures of one run of the outlet, by pace."""
    view: Any = View()
    settings = OpcUaOutletSettings.model_validate({"listen": "127.0.0.1:0", "rate": f"{RATE:g} Hz"})
    outlet = OpcUaOutlet("opc_ua", settings, view)
    given = 0

    async def write(rate: float, count: int) -> None:
        nonlocal given
        async for _ in due(rate, count):
            outlet.offer(frames(given, 1))
            given += 1

    async def work() -> dict[str, dict[str, float]]:
        async with asyncio.timeout(START):
            await until(lambda: outlet.url is not None)
        await write(0, 1)  # the server makes its variables with the first row
        return await _paced(str(outlet.url), await asyncio.to_thread(_serving), write, seconds)

    return await served(outlet, work)


def _serving() -> int:
    """The process of the outlet, a child of this one."""
    return next(each.pid for each in psutil.Process().children() if OpcUaOutlet.module in each.cmdline())


async def theirs(seconds: float) -> dict[str, dict[str, float]]:
    """Figures of one run of the plain server, by pace."""
    async with off_loop(child("opc_ua_plain")) as plain:
        url = await asyncio.to_thread(plain.answer)

        async def write(rate: float, count: int) -> None:
            await asyncio.to_thread(plain.ask, [rate, count])

        return await _paced(url, plain.pid, write, seconds)


async def _paced(url: str, pid: int, write: Write, seconds: float) -> dict[str, dict[str, float]]:
    async with off_loop(child("opc_ua_reader", url)) as reader:
        await asyncio.to_thread(reader.answer)
        await asyncio.to_thread(reader.ask, {})
        await write(0, BLOCK)  # whatever is done once
        await asyncio.to_thread(reader.ask, {"expected": CHANNELS * BLOCK})
        return {name: await _run(pid, reader, write, rate, seconds) for name, rate in PACES.items()}


async def _run(pid: int, reader: Child, write: Write, rate: float, seconds: float) -> dict[str, float]:
    await asyncio.to_thread(reader.ask, {})
    used, began = computed(pid), time.monotonic_ns()
    if rate:
        count = max(round(rate * seconds), 1)
        await write(rate, count)
    else:
        count = await _in_turn(reader, write, seconds)
    offered = CHANNELS * count
    found = await asyncio.to_thread(reader.ask, {"expected": offered})
    used = computed(pid) - used
    span = (found["last"] - found["first"]) / 1e9
    return {
        "values_per_s": (found["count"] - 1) / span if span else 0.0,
        "lost": 1 - found["count"] / offered,
        "core_percent": 100e9 * used / max(found["last"] - began, 1),
        "us_a_value": 1e6 * used / max(found["count"], 1),
    }


async def _in_turn(reader: Child, write: Write, seconds: float) -> int:
    """Write blocks, the next once the client has the last; give how many rows."""
    count, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        await write(0, BLOCK)
        count += BLOCK
        await asyncio.to_thread(reader.ask, {"expected": CHANNELS * count})
    return count
