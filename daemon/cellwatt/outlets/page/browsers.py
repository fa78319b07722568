"""Browsers that follow: what waits for each is bounded, and one that takes nothing is let go."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any, Final

from aiohttp import web

from cellwatt.outlets.zenoh.messages import encode_json

MOST_BYTES: Final = 1_000_000
"""Bytes that may wait for one browser; beyond them its oldest frames go."""
HEARTBEAT: Final = 10.0
"""s without an event after which a comment is sent."""
STALLED: Final = 30.0
"""s after which a browser that takes nothing is disconnected."""
_RETRY: Final = b"retry: 2000\n\n"
_BEAT: Final = b": still here\n\n"


def encoded(event: str, data: Any) -> bytes:
    """An event as it is sent."""
    return b"event: %s\ndata: %s\n\n" % (event.encode(), encode_json(data))


class Browsers:
    """All browsers that follow anything, at most ``most``; ``counts`` of what became of them are for health."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.counts: Counter[str] = Counter()
        self._all: set[Browser] = set()

    def __len__(self) -> int:
        return len(self._all)

    @contextlib.contextmanager
    def one(self, login: object) -> Iterator[Browser]:
        """A browser that begins to follow. Raises ``HTTPServiceUnavailable`` where there is no place for it."""
        if len(self) >= self.most:
            self.counts["browsers refused"] += 1
            raise web.HTTPServiceUnavailable(text=f"{self.most} browsers follow already, the most that may (browsers)")
        browser = Browser(self.counts, login)
        self._all.add(browser)
        try:
            yield browser
        finally:
            self._all.discard(browser)

    def end(self, asks: Callable[[object], bool] = lambda _: True) -> None:
        """End the streams whose login ``asks`` for it."""
        for browser in list(self._all):
            if asks(browser.login):
                browser.end()


class Browser:
    """What waits for one browser; ``login`` tells whose it is."""

    def __init__(self, counts: Counter[str], login: object = None) -> None:
        self.login = login
        self.dropped = 0
        """Blocks of frames that were dropped since the browser was last told."""
        self._counts = counts
        self._waiting: deque[tuple[bool, bytes]] = deque()
        self._size = 0
        self._ended = False
        self._woken = asyncio.Event()

    def put(self, data: bytes, *, frames: bool = False) -> None:
        """Queue an event; where there is no room the oldest frames go, and without any the browser."""
        if self._ended:
            return
        self._waiting.append((frames, data))
        self._size += len(data)
        while self._size > MOST_BYTES and not self._ended:
            self._make_room()
        self._woken.set()

    def _make_room(self) -> None:
        for place, (frames, data) in enumerate(self._waiting):
            if frames:
                del self._waiting[place]
                self._size -= len(data)
                self.dropped += 1
                self._counts["blocks dropped"] += 1
                return
        self._counts["browsers too slow"] += 1
        self.end()

    def end(self) -> None:
        """Send nothing more; the browser asks anew by itself."""
        self._ended = True
        self._waiting.clear()
        self._size = 0
        self._woken.set()

    async def send(self, response: web.StreamResponse) -> None:
        """Send what comes until ``end``. Raises ``TimeoutError`` if the browser takes nothing."""
        await response.write(_RETRY)
        while not self._ended:
            data = await self._next()
            async with asyncio.timeout(STALLED):
                await response.write(data)

    async def _next(self) -> bytes:
        if not self._waiting:
            self._woken.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(HEARTBEAT):
                    await self._woken.wait()
        if self.dropped and not self._ended:
            dropped, self.dropped = self.dropped, 0
            return encoded("behind", {"dropped": dropped})
        if not self._waiting:
            return _BEAT
        _, data = self._waiting.popleft()
        self._size -= len(data)
        return data
