"""A queue from threads to other threads and event loops."""

from __future__ import annotations

import asyncio
import contextlib
import math
import queue
import threading
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _End:
    error: BaseException | None


class Mailbox(Generic[T]):
    """First in, first out; ``take`` waits while it is empty.

    ``put`` never waits: who puts looks at ``full`` first, which is true from ``limit`` items or ``limit_bytes`` on.
    After ``end`` nothing can be put; takers get what is left and then ``None``, or the error it was ended with.
    """

    def __init__(self, limit: int, limit_bytes: float = math.inf) -> None:
        self._limit = limit
        self._limit_bytes = limit_bytes
        self._items: queue.SimpleQueue[tuple[T, int] | _End] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._bytes = 0
        self._waiters: list[tuple[asyncio.AbstractEventLoop, asyncio.Future[None]]] = []
        self._ended = False

    @property
    def full(self) -> bool:
        """True if ``limit`` items or ``limit_bytes`` are waiting."""
        return self._items.qsize() >= self._limit or self._bytes >= self._limit_bytes

    def put(self, item: T, size: int = 0) -> None:
        """Add an item of ``size`` bytes; discard it if the mailbox was ended."""
        if not self._ended:
            self._weigh(size)
            self._items.put((item, size))
            self._tell()

    def end(self, error: BaseException | None = None) -> None:
        """End the mailbox; the reason of the first call counts."""
        if not self._ended:
            self._ended = True
            self._items.put(_End(error))
            self._tell()

    def take(self, timeout: float | None = None) -> T | None:
        """Take the next item. Raises ``TimeoutError`` if none arrives within ``timeout`` s."""
        try:
            return self._open(self._items.get(timeout=timeout))
        except queue.Empty:
            raise TimeoutError(f"nothing came within {timeout} s") from None

    async def take_async(self) -> T | None:
        """Take the next item on an event loop, without a time-out."""
        loop = asyncio.get_running_loop()
        while True:
            with contextlib.suppress(queue.Empty):
                return self._open(self._items.get_nowait())
            waiter: asyncio.Future[None] = loop.create_future()
            self._waiters.append((loop, waiter))
            if self._items.empty():  # else it was put before the putter could see that we wait
                await waiter

    def _open(self, item: tuple[T, int] | _End) -> T | None:
        if not isinstance(item, _End):
            self._weigh(-item[1])
            return item[0]
        self._items.put(item)  # for the next taker
        if item.error is not None:
            raise item.error
        return None

    def _weigh(self, size: int) -> None:
        if size:
            with self._lock:
                self._bytes += size

    def _tell(self) -> None:
        while self._waiters:
            try:
                loop, waiter = self._waiters.pop()
            except IndexError:  # another thread took the last one
                return
            with contextlib.suppress(RuntimeError):  # that loop is closed: nobody waits there any more
                loop.call_soon_threadsafe(_wake, waiter)


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
