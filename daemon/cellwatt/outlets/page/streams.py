"""Streams to browsers: events at once, frames at the browser's rate; what waits for each is bounded."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

from aiohttp import web

from cellwatt.frames import Frames
from cellwatt.outlets.page import shapes
from cellwatt.outlets.zenoh.messages import encode_json

log = logging.getLogger(__name__)

MOST_BYTES: Final = 1_000_000
"""Bytes of events that may wait for one browser."""
MOST_VALUES: Final = 100_000
"""Values of frames that may wait for it, or two periods of its own where they are more; beyond, the oldest go."""
_PREDICTIONS: Final = 4096
"""Outputs of models that may wait for it."""
HEARTBEAT: Final = 10.0
"""s without an event after which a comment is sent."""
STALLED: Final = 30.0
"""s after which a browser that takes nothing is disconnected."""
_SENT: Final = 65536
"""Bytes that the system may keep for one browser."""
_RETRY: Final = b"retry: 2000\n\n"
_BEAT: Final = b": still here\n\n"

Body = Mapping[str, Any]


def encoded(event: str, data: Any) -> bytes:
    """An event as it is sent."""
    return b"event: %s\ndata: %s\n\n" % (event.encode(), encode_json(data))


class Browsers:
    """All browsers that follow anything, at most ``most``; ``counts`` of what became of them are for health."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.counts: Counter[str] = Counter()
        self.all: set[Browser] = set()

    def __len__(self) -> int:
        return len(self.all)

    def end(self, asks: Callable[[object], bool] = lambda _: True) -> None:
        """End the streams whose login ``asks`` for it."""
        for browser in list(self.all):
            if asks(browser.login):
                browser.end()


class Hub:
    """Passes on what one cell tells to all browsers that follow it."""

    def __init__(self, browsers: Browsers) -> None:
        self._browsers = browsers
        self.members: set[Browser] = set()

    def __len__(self) -> int:
        return len(self.members)

    def frames(self, frames: Frames) -> None:
        """Pass on frames."""
        for browser in self.members:
            browser.put_frames(frames)

    def prediction(self, body: Body) -> None:
        """Pass on a model's output."""
        for browser in self.members:
            browser.predictions.append(body)

    def tell(self, event: str, data: Any) -> None:
        """Pass on an event at once."""
        message = encoded(event, data) if self.members else b""
        for browser in self.members:
            browser.put(message)

    def end(self) -> None:
        """End all streams of this cell; their browsers ask anew by themselves."""
        for browser in self.members:
            browser.end()

    async def serve(
        self,
        request: web.Request,
        channels: Sequence[str],
        rate: float,
        login: object = None,
        first: Sequence[bytes] = (),
    ) -> web.StreamResponse:
        """Stream to one browser until either side ends: ``first``, events, and frames of ``channels`` at ``rate``, Hz.

        Raises ``HTTPServiceUnavailable`` where there is no place for it.
        """
        with self._member(channels, rate, login) as browser:
            for data in first:
                browser.put(data)
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
    def _member(self, channels: Sequence[str], rate: float, login: object) -> Iterator[Browser]:
        most, counts = self._browsers.most, self._browsers.counts
        if len(self._browsers) >= most:
            counts["browsers refused"] += 1
            raise web.HTTPServiceUnavailable(text=f"{most} browsers follow already, the most that may (browsers)")
        browser = Browser(counts, channels, rate, login)
        for group in (self._browsers.all, self.members):
            group.add(browser)
        try:
            yield browser
        finally:
            for group in (self._browsers.all, self.members):
                group.discard(browser)


class Browser:
    """What waits for one browser; ``login`` tells whose it is."""

    def __init__(
        self, counts: Counter[str], channels: Sequence[str] = (), rate: float = 1.0, login: object = None
    ) -> None:
        self.login = login
        self.predictions: deque[Body] = deque(maxlen=_PREDICTIONS)
        """Outputs of models that wait for the next tick, …"""
        self.frames: deque[Frames] = deque()
        """… and frames."""
        self.dropped = 0
        """Blocks of frames that were dropped since the browser was last told."""
        self._counts, self._channels, self._period = counts, channels, 1.0 / rate
        self._events: deque[bytes] = deque()
        self._size = 0
        self._due = 0.0
        self._ended = False
        self._woken = asyncio.Event()

    def put(self, data: bytes) -> None:
        """Queue an event; without room for it the stream ends."""
        if self._ended:
            return
        self._events.append(data)
        self._size += len(data)
        if self._size > MOST_BYTES:
            self._counts["browsers too slow"] += 1
            self.end()
        self._woken.set()

    def put_frames(self, frames: Frames) -> None:
        """Queue frames; without room the oldest go."""
        if self._ended:
            return
        self.frames.append(frames)
        columns = 1 + len(self._channels)
        most = max(MOST_VALUES, 2 * self._period * frames.layout.rate * columns)
        while len(self.frames) > 1 and sum(map(len, self.frames)) * columns > most:
            self.frames.popleft()
            self.dropped += 1
            self._counts["blocks dropped"] += 1

    def end(self) -> None:
        """Send nothing more; the browser asks anew by itself."""
        self._ended, self._size = True, 0
        for waiting in (self._events, self.frames, self.predictions):
            waiting.clear()
        self._woken.set()

    async def send(self, response: web.StreamResponse) -> None:
        """Send what comes until ``end``. Raises ``TimeoutError`` if the browser takes nothing."""
        await response.write(_RETRY)
        while not self._ended:
            data = await self._next()
            async with asyncio.timeout(STALLED):
                await response.write(data)

    async def _next(self) -> bytes:
        """What is to be sent next, once there is something."""
        clock = asyncio.get_running_loop().time
        quiet = clock() + HEARTBEAT
        while not self._ended and clock() < quiet:
            if self.dropped:
                dropped, self.dropped = self.dropped, 0
                return encoded("behind", {"dropped": dropped})
            if self._events:
                data = self._events.popleft()
                self._size -= len(data)
                return data
            if clock() >= self._due:
                self._due = max(self._due + self._period, clock())
                if data := b"".join(self._blocks()):
                    return data
            self._woken.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(min(quiet, self._due)):
                    await self._woken.wait()
        return _BEAT

    def _blocks(self) -> Iterator[bytes]:
        """Frames and outputs of models that came since the last tick."""
        newest = [block for block in self.frames if block.layout == self.frames[-1].layout and len(block)]
        self.frames.clear()
        if newest:
            yield _shaped("frames", partial(shapes.frames, newest, self._channels))
        models: dict[tuple[str, tuple[str, ...]], list[Body]] = {}
        for body in self.predictions:
            models.setdefault((body["model"], tuple(body["outputs"])), []).append(body)
        self.predictions.clear()
        for (model, _), bodies in models.items():
            yield _shaped("prediction", partial(shapes.prediction, model, bodies))


def _shaped(event: str, shape: Callable[[], Any]) -> bytes:
    """An event of what waited; nothing of what breaks its own contract, which costs no stream."""
    try:
        return encoded(event, shape())
    except Exception:
        log.exception("page: %s cannot be shown", event)
        return b""
