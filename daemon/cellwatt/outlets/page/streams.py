"""Streams to browsers: blocks of frames are made once for all that want the same; what waits for each is bounded."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from aiohttp import web

from cellwatt.frames import Frames
from cellwatt.outlets.page import shapes
from cellwatt.outlets.zenoh.messages import encode_json

log = logging.getLogger(__name__)

_SENT: Final = 65536
"""Bytes that the system may keep for one browser."""
_FRESH: Final = 4096
"""Blocks that may wait for one tick of a group."""

Body = Mapping[str, Any]


class Group:
    """Browsers that want the same channels at the same rate, or, of ``None``, no frames; blocks are made once."""

    def __init__(self, channels: Sequence[str] | None, rate: float) -> None:
        self.channels, self.period = channels, 1.0 / rate
        self.members: set[Browser] = set()
        self.frames: deque[Frames] = deque(maxlen=_FRESH)
        """Blocks that wait for the next tick, and outputs of models."""
        self.predictions: deque[Body] = deque(maxlen=_FRESH)
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + self.period, loop.time())
            await asyncio.sleep(due - loop.time())
            try:
                for data in self._blocks():
                    for browser in self.members:
                        browser.put(data, frames=True)
            except Exception:
                log.exception("a block for browsers cannot be made")

    def _blocks(self) -> Iterator[bytes]:
        newest = [block for block in self.frames if block.layout == self.frames[-1].layout and len(block)]
        self.frames.clear()
        if newest:
            yield encoded("frames", shapes.frames(newest, self.channels or ()))
        models: dict[tuple[str, tuple[str, ...]], list[Body]] = {}
        for body in self.predictions:
            models.setdefault((body["model"], tuple(body["outputs"])), []).append(body)
        self.predictions.clear()
        for (model, _), bodies in models.items():
            yield encoded("prediction", shapes.prediction(model, bodies))


class Hub:
    """Passes on what one cell tells to all browsers that follow it."""

    def __init__(self, browsers: Browsers) -> None:
        self._browsers = browsers
        self._groups: dict[tuple[tuple[str, ...] | None, float], Group] = {}

    def __len__(self) -> int:
        return sum(len(group.members) for group in self._groups.values())

    def _all(self) -> list[Browser]:
        return [browser for group in self._groups.values() for browser in group.members]

    def frames(self, frames: Frames) -> None:
        """Pass on frames."""
        for group in self._groups.values():
            group.frames.append(frames)

    def prediction(self, body: Body) -> None:
        """Pass on a model's output."""
        for group in self._groups.values():
            group.predictions.append(body)

    def tell(self, event: str, data: Any) -> None:
        """Pass on an event at once."""
        if not self._groups:
            return
        message = encoded(event, data)
        for browser in self._all():
            browser.put(message)

    def end(self) -> None:
        """End all streams of this cell; their browsers ask anew by themselves."""
        for browser in self._all():
            browser.end()

    async def serve(
        self,
        request: web.Request,
        channels: Sequence[str] | None,
        rate: float,
        login: object = None,
        first: Sequence[bytes] = (),
    ) -> web.StreamResponse:
        """Stream to one browser until either side ends; ``channels`` ``None``: events without frames.

        ``first`` is sent before all else.
        """
        with self._browsers.one(login) as browser:
            for data in first:
                browser.put(data)
            with self._member(browser, channels, rate):
                headers = {"Content-Type": "text/event-stream", "X-Accel-Buffering": "no", "Cache-Control": "no-store"}
                response = web.StreamResponse(headers=headers)
                if request.transport is not None:  # the system keeps little: what a browser does not take shows here
                    request.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SENT)
                await response.prepare(request)
                try:
                    await browser.send(response)
                except TimeoutError:
                    self._browsers.counts["browsers too slow"] += 1
                    if isinstance(request.transport, asyncio.Transport):
                        request.transport.abort()
                except ConnectionError:
                    pass  # it has left
            return response

    @contextlib.contextmanager
    def _member(self, browser: Browser, channels: Sequence[str] | None, rate: float) -> Iterator[None]:
        key = None if channels is None else tuple(channels), rate
        group = self._groups.get(key) or self._groups.setdefault(key, Group(*key))
        group.members.add(browser)
        try:
            yield
        finally:
            group.members.discard(browser)
            if not group.members:
                del self._groups[key]
                group.task.cancel()


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
