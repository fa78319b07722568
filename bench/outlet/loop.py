"""An outlet that runs beside other work, and how late its event loop is."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager, suppress
from typing import Any, TypeVar

import numpy as np

from cellwatt.errors import OutletError
from cellwatt.ticker import Ticker

T = TypeVar("T")


@contextmanager
def steps() -> Iterator[list[float]]:
    """The computing time of each step on the loop, s, which other processes of a busy PC do not lengthen."""
    found: list[float] = []
    kind: Any = asyncio.Handle
    run = kind._run

    def timed(handle: Any) -> None:
        began = time.thread_time()
        run(handle)
        found.append(time.thread_time() - began)

    kind._run = timed
    try:
        yield found
    finally:
        kind._run = run


async def ticks(seconds: float, each: Callable[[int], None]) -> dict[str, float]:
    """Lateness of a ticker of 1 kHz, also of beats that were merged, while ``each`` gets the number of each.

    ``step``: the longest computing of the loop between two looks at its sockets and timers.
    """
    late: list[float] = []
    with steps() as computing:
        await _tick(seconds, each, late)
    found = np.array(late)
    figures = {f"p{p:g}_us": float(np.percentile(found, p)) for p in (50, 99, 99.9)}
    return {**figures, "most_us": float(found.max()), "longest_step_us": 1e6 * max(computing)}


async def _tick(seconds: float, each: Callable[[int], None], late: list[float]) -> None:
    number = 0
    async with Ticker(1000.0) as ticker:
        async for tick in ticker:
            late += [1e6 * tick.lateness + 1000.0 * passed for passed in range(tick.merged + 1)]
            each(number)
            number += 1 + tick.merged
            if number >= seconds * 1000:
                break


async def served(outlet: Any, work: Callable[[], Awaitable[T]]) -> T:
    """Do some work while an outlet runs, again and again where it fails."""

    async def run() -> None:
        while True:
            with suppress(OutletError):
                await outlet.run()
            await asyncio.sleep(0.5)

    task = asyncio.create_task(run())
    try:
        return await work()
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@asynccontextmanager
async def off_loop(context: AbstractContextManager[T]) -> AsyncIterator[T]:
    """A context whose beginning and end block, beside the loop."""
    entered = await asyncio.to_thread(context.__enter__)
    try:
        yield entered
    finally:
        await asyncio.to_thread(context.__exit__, None, None, None)


async def until(condition: Callable[[], bool], pause: float = 0.01) -> None:
    """Look every ``pause`` s until a condition holds."""
    while not condition():  # noqa: ASYNC110 (what is measured tells nobody)
        await asyncio.sleep(pause)
