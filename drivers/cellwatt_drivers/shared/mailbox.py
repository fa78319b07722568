"""What a device sends by itself, on its way from a callback to the driver."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

from cellwatt.errors import SourceError

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Keeps ``most`` messages in order; ``dropped`` counts older ones that nobody took in time."""

    def __init__(self, most: int) -> None:
        self.dropped = 0
        self._most = most
        self._messages: deque[T] = deque()
        self._failure: SourceError | None = None
        self._news = asyncio.Event()

    def take(self, message: T) -> None:
        """A message came."""
        if len(self._messages) >= self._most:
            self._messages.popleft()
            self.dropped += 1
        self._messages.append(message)
        self._news.set()

    def fail(self, error: SourceError) -> None:
        """Nothing more will come, for this reason."""
        self._failure = self._failure or error
        self._news.set()

    async def given(self, seconds: float, at_once: int | None = None, gather: float = 0.0) -> list[T]:
        """Messages in order, at most ``at_once``; none where none came within ``seconds``.

        ``gather`` s after the first they are taken, with those that came meanwhile. Raises what ``fail`` was given once
        all messages are taken.
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
