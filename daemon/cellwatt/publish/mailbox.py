"""A queue from threads to other threads and event loops."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """First in, first out; ``take`` waits while there is nothing.

    ``put`` never waits: who puts looks at ``full`` first, which is true from ``limit`` items on. After ``end`` nothing
    can be put; takers get what is left and then ``None``, or the error it was ended with.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._items: deque[T] = deque()
        self._changed = threading.Condition()
        self._waiters: list[tuple[asyncio.AbstractEventLoop, asyncio.Future[None]]] = []
        self._ended = False
        self._error: BaseException | None = None

    @property
    def full(self) -> bool:
        """Whether takers have fallen behind by ``limit`` items."""
        return len(self._items) >= self._limit

    def put(self, item: T) -> None:
        """Add an item; lets it go when the mailbox was ended."""
        with self._changed:
            if not self._ended:
                self._items.append(item)
                self._tell()

    def end(self, error: BaseException | None = None) -> None:
        """Nothing more comes."""
        with self._changed:
            self._ended, self._error = True, self._error or error
            self._tell()

    def take(self, timeout: float | None = None) -> T | None:
        """The next item. Raises ``TimeoutError`` when none comes within ``timeout`` s."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._items or self._ended, timeout):
                raise TimeoutError(f"nothing came within {timeout} s")
            return self._pop()

    async def take_async(self) -> T | None:
        """The same on an event loop."""
        loop = asyncio.get_running_loop()
        while True:
            with self._changed:
                if self._items or self._ended:
                    return self._pop()
                waiter: asyncio.Future[None] = loop.create_future()
                self._waiters.append((loop, waiter))
            await waiter

    def _pop(self) -> T | None:
        if self._items:
            return self._items.popleft()
        if self._error is not None:
            raise self._error
        return None

    def _tell(self) -> None:
        self._changed.notify_all()
        for loop, waiter in self._waiters:
            with contextlib.suppress(RuntimeError):  # that loop is closed: nobody waits there any more
                loop.call_soon_threadsafe(_wake, waiter)
        self._waiters.clear()


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
