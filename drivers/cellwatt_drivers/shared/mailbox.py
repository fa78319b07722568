"""Messages that a device sends unasked, queued between a callback and the driver."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

from cellwatt.errors import SourceError

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Queues at most ``most`` messages in order; ``dropped`` counts older messages that were discarded unread."""

    def __init__(self, most: int) -> None:
        self.dropped = 0
        self._most = most
        self._messages: deque[T] = deque()
        self._failure: SourceError | None = None
        self._news = asyncio.Event()

    def __len__(self) -> int:
        return len(self._messages)

    def take(self, message: T) -> None:
        """Add a received message."""
        if len(self._messages) >= self._most:
            self._messages.popleft()
            self.dropped += 1
        self._messages.append(message)
        self._news.set()

    def fail(self, error: SourceError) -> None:
        """End the mailbox with an error: no further message will arrive."""
        self._failure = self._failure or error
        self._news.set()

    async def given(self, seconds: float, at_once: int | None = None, gather: float = 0.0) -> list[T]:
        """Messages in order, at most ``at_once``; empty if none arrives within ``seconds``.

        Waits ``gather`` s after the first message to return later ones with it. Raises the error given to ``fail`` once
        all messages are returned.
        """
        try:
            async with asyncio.timeout(seconds):
                await self._news.wait()
        except TimeoutError:
            return []
        if gather:
            await asyncio.sleep(gather)
        self._news.clear()
        count = len(self._messages) if at_once is None else min(at_once, len(self._messages))
        found = [self._messages.popleft() for _ in range(count)]
        if not found and self._failure is not None:
            raise self._failure
        if self._failure is not None or self._messages:
            self._news.set()
        return found
