"""Devices that block while they open and close, and libraries that lose cancellations."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TypeVar

T = TypeVar("T")


@asynccontextmanager
async def opened_aside(open_device: Callable[[], T], close: Callable[[T], object]) -> AsyncIterator[T]:
    """Open a device in a thread, and close it in a thread at the end. Raises what ``open_device`` raises.

    If the task is cancelled while the device opens, the device is closed as soon as it is open.
    """

    def discard(opening: asyncio.Future[T]) -> None:
        if not opening.cancelled() and opening.exception() is None:
            close(opening.result())

    opening = asyncio.ensure_future(asyncio.to_thread(open_device))
    try:
        device = await asyncio.shield(opening)
    except asyncio.CancelledError:
        opening.add_done_callback(discard)
        raise
    try:
        yield device
    finally:
        await asyncio.shield(asyncio.to_thread(close, device))


def obey_cancellation() -> None:
    """Raise ``asyncio.CancelledError`` if the task is cancelled.

    Libraries use ``asyncio.wait_for``, which up to Python 3.11 loses a cancellation that coincides with the answer.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
