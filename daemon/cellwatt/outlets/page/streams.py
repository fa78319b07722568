"""Streams to browsers: events at once, frames at the browser's rate; the queues of each browser are bounded."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

from aiohttp import web

from cellwatt.frames import Frames
from cellwatt.outlets.page import shapes
from cellwatt.outlets.zenoh.messages import encode_json
from cellwatt.results import Prediction

log = logging.getLogger(__name__)

MOST_BYTES: Final = 1_000_000
"""Largest size, bytes, of the events that wait for one browser."""
MOST_VALUES: Final = 100_000
"""Largest number of frame values that wait for one browser, or two of its periods if more; the oldest are dropped."""
_PREDICTIONS: Final = 4096
"""Largest number of predictions that wait for one browser."""
HEARTBEAT: Final = 10.0
"""Time, s, without an event after which a comment is sent."""
STALLED: Final = 30.0
"""Time, s, after which a browser that receives nothing is disconnected."""
_SENT: Final = 65536
"""Send buffer, bytes, of the operating system for one browser."""
_RETRY: Final = b"retry: 2000\n\n"
_BEAT: Final = b": still here\n\n"


def encoded(event: str, data: Any) -> bytes:
    """An event in the format of server-sent events."""
    return b"event: %s\ndata: %s\n\n" % (event.encode(), encode_json(data))


class Browsers:
    """All browsers with a stream, at most ``most``; ``counts`` of refused and slow browsers are part of health."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.counts: Counter[str] = Counter()
        self.all: set[Browser] = set()

    def __len__(self) -> int:
        return len(self.all)

    def end(self, asks: Callable[[object], bool] = lambda _: True) -> None:
        """End the streams of the browsers whose login satisfies ``asks``."""
        for browser in list(self.all):
            if asks(browser.login):
                browser.end()


class Hub:
    """Sends the messages of one cell to all browsers that follow it."""

    def __init__(self, browsers: Browsers) -> None:
        self._browsers = browsers
        self.members: set[Browser] = set()

    def __len__(self) -> int:
        return len(self.members)

    def frames(self, frames: Frames) -> None:
        """Send frames."""
        for browser in self.members:
            browser.put_frames(frames)

    def prediction(self, item: Prediction) -> None:
        """Send a prediction."""
        for browser in self.members:
            browser.predictions.append(item)

    def tell(self, event: str, data: Any) -> None:
        """Send an event at once."""
        message = encoded(event, data) if self.members else b""
        for browser in self.members:
            browser.put(message)

    def end(self) -> None:
        """End all streams of this cell; the browsers reconnect by themselves."""
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

        Raises ``HTTPServiceUnavailable`` if there are too many browsers.
        """
        with self._member(channels, rate, login) as browser:
            for data in first:
                browser.put(data)
            headers = {"Content-Type": "text/event-stream", "X-Accel-Buffering": "no", "Cache-Control": "no-store"}
            response = web.StreamResponse(headers=headers)
            if request.transport is not None:  # a small buffer, so that a slow browser is noticed here
                request.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SENT)
            try:
                await response.prepare(request)
                await browser.send(response)
            except TimeoutError:
                self._browsers.counts["browsers too slow"] += 1
                if isinstance(request.transport, asyncio.Transport):
                    request.transport.abort()
            except ConnectionError:
                pass  # the browser has disconnected
        return response

    @contextlib.contextmanager
    def _member(self, channels: Sequence[str], rate: float, login: object) -> Iterator[Browser]:
        most, counts = self._browsers.most, self._browsers.counts
        if len(self._browsers) >= most:
            counts["browsers refused"] += 1
            raise web.HTTPServiceUnavailable(text=f"{most} browsers are connected, the maximum (page: browsers)")
        browser = Browser(counts, channels, rate, login)
        for group in (self._browsers.all, self.members):
            group.add(browser)
        try:
            yield browser
        finally:
            for group in (self._browsers.all, self.members):
                group.discard(browser)


class Browser:
    """Queues of one browser; ``login`` identifies its user."""

    def __init__(
        self, counts: Counter[str], channels: Sequence[str] = (), rate: float = 1.0, login: object = None
    ) -> None:
        self.login = login
        self.predictions: deque[Prediction] = deque(maxlen=_PREDICTIONS)
        """Predictions that wait for the next period, …"""
        self.frames: deque[Frames] = deque()
        """… and frames."""
        self.dropped = 0
        """Blocks of frames dropped since the last report to the browser."""
        self._counts, self._channels, self._period = counts, channels, 1.0 / rate
        self._events: deque[bytes] = deque()
        self._size = 0
        self._due = 0.0
        self._ended = False
        self._woken = asyncio.Event()

    def put(self, data: bytes) -> None:
        """Queue an event; if the queue is full, the stream ends."""
        if self._ended:
            return
        self._events.append(data)
        self._size += len(data)
        if self._size > MOST_BYTES:
            self._counts["browsers too slow"] += 1
            self.end()
        self._woken.set()

    def put_frames(self, frames: Frames) -> None:
        """Queue frames; if the queue is full, drop the oldest."""
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
        """Stop sending; the browser reconnects by itself."""
        self._ended, self._size = True, 0
        for waiting in (self._events, self.frames, self.predictions):
            waiting.clear()
        self._woken.set()

    async def send(self, response: web.StreamResponse) -> None:
        """Send queued data until ``end``. Raises ``TimeoutError`` if the browser receives nothing."""
        await response.write(_RETRY)
        while not self._ended:
            data = await self._next()
            async with asyncio.timeout(STALLED):
                await response.write(data)

    async def _next(self) -> bytes:
        """Wait for the next data to send; a heartbeat after ``HEARTBEAT`` s without data."""
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
        """Frames and predictions queued since the last period."""
        newest = [block for block in self.frames if block.layout == self.frames[-1].layout and len(block)]
        self.frames.clear()
        if newest:
            yield _shaped("frames", partial(shapes.frames, newest, self._channels))
        models: dict[tuple[str, tuple[str, ...]], list[Prediction]] = {}
        for item in self.predictions:
            models.setdefault((item.model, tuple(item.outputs)), []).append(item)
        self.predictions.clear()
        for (model, _), items in models.items():
            yield _shaped("prediction", partial(shapes.prediction, model, items))


def _shaped(event: str, shape: Callable[[], Any]) -> bytes:
    """An event with queued data; ``b""`` if the data are malformed, so that the stream continues."""
    try:
        return encoded(event, shape())
    except Exception:
        log.exception("page: %s cannot be shown", event)
        return b""
