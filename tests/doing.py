"""Works that go on while a test looks at them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, suppress
from typing import Any


@asynccontextmanager
async def doing(
    *works: Coroutine[Any, Any, Any], allowed: tuple[type[Exception], ...] = ()
) -> AsyncIterator[asyncio.Task[Any]]:
    """Do works until the end of the context, then cancel them, the last first; gives the first.

    Raises what any of them raised, but for what is ``allowed``.
    """
    tasks = [asyncio.create_task(work) for work in works]
    try:
        yield tasks[0]
    finally:
        for task in reversed(tasks):
            task.cancel()
            with suppress(asyncio.CancelledError, *allowed):
                await task
