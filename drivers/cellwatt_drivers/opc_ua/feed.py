"""What a subscription publishes, on its way to the driver."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import TYPE_CHECKING, Final

from cellwatt.errors import ConnectError, SourceError

if TYPE_CHECKING:
    from asyncua import ua

_MOST: Final = 1000
"""Messages that wait for the driver; beyond it the oldest are given up."""


class Feed:
    """Messages of a session's subscription in order; ``dropped`` counts those that nobody took in time."""

    def __init__(self) -> None:
        self.dropped = 0
        self._messages: deque[ua.PublishResult] = deque()
        self._failure: SourceError | None = None
        self._news = asyncio.Event()

    def take(self, message: ua.PublishResult) -> None:
        """A message came."""
        if len(self._messages) >= _MOST:
            self._messages.popleft()
            self.dropped += 1
        self._messages.append(message)
        self._news.set()

    def fail(self, error: SourceError) -> None:
        """The connection is of no use any more, for this reason."""
        self._failure = self._failure or error
        self._news.set()

    async def messages(self, silence: float) -> list[ua.PublishResult]:
        """Wait for messages, ``silence`` s at most. Raises ``SourceError`` where none is left of a lost connection."""
        try:
            async with asyncio.timeout(silence):
                await self._news.wait()
        except TimeoutError:
            raise ConnectError(f"no sign of life of the subscription for {silence:g} s") from None
        self._news.clear()
        found = list(self._messages)
        self._messages.clear()
        if not found and self._failure is not None:
            raise self._failure
        if self._failure is not None:
            self._news.set()
        return found
