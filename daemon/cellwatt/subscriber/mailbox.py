"""A queue from threads to other threads and event loops."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections import deque
from concurrent.futures import Future, InvalidStateError
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """First in, first out; ``take`` waits while it is empty.

    ``put`` never waits: who puts looks at ``full`` first, which is true from ``limit`` items or ``limit_bytes`` on.
    After ``end`` nothing can be put; takers get what is left and then ``None``, or the error it was ended with.
    """

    def __init__(self, limit: int, limit_bytes: float = math.inf) -> None:
        self._limit, self._limit_bytes = limit, limit_bytes
        self._items: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._waiters: list[Future[None]] = []
        self._lock = threading.Lock()
        self._ended = False
        self._error: BaseException | None = None

    @property
    def full(self) -> bool:
        """True if ``limit`` items or ``limit_bytes`` are waiting."""
        return len(self._items) >= self._limit or self._bytes >= self._limit_bytes

    def put(self, item: T, size: int = 0) -> None:
        """Add an item of ``size`` bytes; discard it if the mailbox was ended."""
        with self._lock:
            if self._ended:
                return
            self._items.append((item, size))
            self._bytes += size
        self._wake()

    def end(self, error: BaseException | None = None) -> None:
        """End the mailbox; the reason of the first call counts."""
        with self._lock:
            if not self._ended:
                self._ended, self._error = True, error
        self._wake()

    def take(self, timeout: float | None = None) -> T | None:
        """Take the next item. Raises ``TimeoutError`` if none arrives within ``timeout`` s."""
        end = math.inf if timeout is None else time.monotonic() + timeout
        while isinstance(found := self._next(), Future):
            try:
                found.result(None if timeout is None else max(end - time.monotonic(), 0.0))
            except TimeoutError:
                raise TimeoutError(f"nothing came within {timeout} s") from None
            finally:
                found.cancel()
        return found

    async def take_async(self) -> T | None:
        """Take the next item on an event loop, without a time-out."""
        while isinstance(found := self._next(), Future):
            await asyncio.wrap_future(found)
        return found

    def _next(self) -> T | Future[None] | None:
        """The next item, ``None`` at the end, or what is done once there may be one."""
        with self._lock:
            if self._items:
                item, size = self._items.popleft()
                self._bytes -= size
                return item
            if self._error is not None:
                raise self._error
            if self._ended:
                return None
            waiter: Future[None] = Future()
            self._waiters = [*(w for w in self._waiters if not w.done()), waiter]
            return waiter

    def _wake(self) -> None:
        if self._waiters:
            with self._lock:
                waiters, self._waiters = self._waiters, []
            for waiter in waiters:
                with contextlib.suppress(InvalidStateError):  # it was given up
                    waiter.set_result(None)
