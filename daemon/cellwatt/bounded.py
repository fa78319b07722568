"""A bounded queue between two tasks of one event loop that reports every item it drops."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class QueueClosedError(Exception):
    """The queue was closed: nothing can be added, and the reader has taken everything."""


class BoundedQueue(Generic[T]):
    """First in, first out, at most ``limit`` of summed weight (items, samples or bytes, as the user counts).

    When full, a queue without ``on_drop`` blocks: ``put`` waits and ``put_nowait`` raises
    ``asyncio.QueueFull``. With ``on_drop`` it drops the oldest items to make room and hands each to it. An
    item heavier than ``limit`` is taken when the queue is empty, so that it cannot wait for ever.

    After ``close`` the reader gets what is left and then ``QueueClosedError``; writers get ``QueueClosedError`` at
    once. A cancelled ``get`` or ``put`` loses and duplicates nothing.
    """

    def __init__(self, limit: int, on_drop: Callable[[T], None] | None = None) -> None:
        if limit < 1:
            raise ValueError(f"the limit of a queue must be at least 1, not {limit}")
        self.limit = limit
        self._on_drop = on_drop
        self._items: deque[tuple[T, int]] = deque()
        self._weight = 0
        self._closed = False
        self._getters: deque[asyncio.Future[None]] = deque()
        self._putters: deque[asyncio.Future[None]] = deque()

    def __len__(self) -> int:
        return len(self._items)

    @property
    def weight(self) -> int:
        """Summed weight of the waiting items."""
        return self._weight

    @property
    def closed(self) -> bool:
        """True after ``close``."""
        return self._closed

    def put_nowait(self, item: T, weight: int = 1) -> None:
        """Append an item. Raises ``QueueClosedError``, or ``asyncio.QueueFull`` in a queue that blocks."""
        if self._closed:
            raise QueueClosedError
        if self._weight + weight > self.limit and self._items:
            if self._on_drop is None:
                raise asyncio.QueueFull
            self._make_room(weight, self._on_drop)
        self._items.append((item, weight))
        self._weight += weight
        _wake_one(self._getters)

    async def put(self, item: T, weight: int = 1) -> None:
        """Append an item; waits for room where the queue blocks. Raises ``QueueClosedError``."""
        while not self._closed and self._on_drop is None and self._items and self._weight + weight > self.limit:
            await _wait(self._putters)
        try:
            self.put_nowait(item, weight)
        finally:
            self._wake_putter()

    async def get(self) -> T:
        """Take the oldest item; waits for one. Raises ``QueueClosedError`` once closed and empty."""
        await self._filled()
        item, weight = self._items.popleft()
        self._weight -= weight
        if self._items:
            _wake_one(self._getters)
        self._wake_putter()
        return item

    def close(self) -> None:
        """Refuse further items; the reader still gets the waiting ones."""
        self._closed = True
        for waiting in (*self._getters, *self._putters):
            if not waiting.done():
                waiting.set_result(None)

    async def _filled(self) -> None:
        while not self._items:
            if self._closed:
                raise QueueClosedError
            await _wait(self._getters)

    def _make_room(self, weight: int, on_drop: Callable[[T], None]) -> None:
        while self._items and self._weight + weight > self.limit:
            item, its = self._items.popleft()
            self._weight -= its
            on_drop(item)

    def _wake_putter(self) -> None:
        if self._putters and self._weight < self.limit:
            _wake_one(self._putters)


async def _wait(waiters: deque[asyncio.Future[None]]) -> None:
    """Sleep until woken; a waiter that is cancelled after it was woken passes its turn on."""
    turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    waiters.append(turn)
    try:
        await turn
    except BaseException:
        if turn.done() and not turn.cancelled():
            _wake_one(waiters)
        raise
    finally:
        if turn in waiters:
            waiters.remove(turn)


def _wake_one(waiters: deque[asyncio.Future[None]]) -> None:
    while waiters:
        turn = waiters.popleft()
        if not turn.done():
            turn.set_result(None)
            return
