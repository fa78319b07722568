"""Deadlines without drift, to a tenth of a millisecond, and a count of the missed ones.

asyncio rounds its time-outs up to 1 ms. Here one Linux timerfd per event loop, read through
``loop.add_reader``, wakes all tickers of that loop at their absolute deadlines on CLOCK_MONOTONIC.
"""

from __future__ import annotations

import asyncio
import ctypes
import heapq
import os
import time
from collections.abc import AsyncIterator
from typing import NamedTuple

_SPREAD_NS = 20_000_000
"""Longest time, ns, between the first deadlines of one loop's tickers, so that they do not fall due together."""
_GOLDEN = 0.6180339887498949
_CLOCKS: dict[asyncio.AbstractEventLoop, _LoopClock] = {}

_LIBC = ctypes.CDLL(None, use_errno=True)
_TFD_TIMER_ABSTIME = 1


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), f"timerfd: {os.strerror(ctypes.get_errno())}")
    return result


def _arm(fd: int, deadline: int) -> None:
    seconds, nanoseconds = divmod(deadline, 1_000_000_000)
    spec = (ctypes.c_long * 4)(0, 0, seconds, nanoseconds)  # struct itimerspec: interval, then value
    _checked(_LIBC.timerfd_settime(fd, _TFD_TIMER_ABSTIME, spec, None))


class Beat(NamedTuple):
    """One turn of a ``Ticker``.

    ``deadline`` is the newest due deadline, ns of CLOCK_MONOTONIC (``time.monotonic_ns``); ``merged`` is the number of
    deadlines before it that passed unserved since the last turn.
    """

    deadline: int
    merged: int

    @property
    def lateness(self) -> float:
        """Time since the deadline, s; at the start of a turn, its delay."""
        return max(0.0, (time.monotonic_ns() - self.deadline) * 1e-9)


class Ticker:
    """Beats at ``rate`` Hz: ``async with Ticker(50.0) as ticker: async for tick in ticker: ...``.

    Deadlines are first + k / rate, however long the body takes. A body that overruns gets the newest due deadline at
    once, with the number of deadlines merged into it. Cancelling a wait loses no deadline. Serves one task at a time;
    Linux only. Raises ``ValueError`` if the rate is not above zero.
    """

    def __init__(self, rate: float) -> None:
        if not 0.0 < rate <= 1e6:
            raise ValueError(f"the rate of a ticker must be above 0 and at most 1 MHz, not {rate} Hz")
        self.rate = rate
        self._period = 1e9 / rate
        self._first = 0
        self._next = 0
        self._clock: _LoopClock | None = None
        self._waiting: asyncio.Future[None] | None = None

    async def __aenter__(self) -> Ticker:
        if self._clock is not None:
            raise RuntimeError("this ticker is running already")
        self._clock = _LoopClock.of(asyncio.get_running_loop())
        self._first = self._clock.enter(self._period)
        self._next = 0
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._clock is not None:
            self._clock.leave(self)
            self._clock = None

    def __aiter__(self) -> AsyncIterator[Beat]:
        return self

    async def __anext__(self) -> Beat:
        if self._clock is None:
            raise RuntimeError("a ticker runs inside 'async with' only")
        if self._waiting is not None:
            raise RuntimeError("a ticker serves one task at a time")
        if time.monotonic_ns() >= self._deadline(self._next):
            await asyncio.sleep(0)  # a body that always overruns must not starve the loop
        else:
            await self._sleep(self._clock, self._deadline(self._next))
        return self._take()

    def skip(self) -> None:
        """Skip the next deadline: no task wakes for it, and it counts as served."""
        self._next += 1

    async def until(self, moment: int) -> None:
        """Wait until a time that is not a deadline, ns of CLOCK_MONOTONIC."""
        assert self._clock is not None
        await self._sleep(self._clock, moment)

    def _wake(self) -> None:
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)

    async def _sleep(self, clock: _LoopClock, moment: int) -> None:
        self._waiting = clock.loop.create_future()
        try:
            clock.schedule(moment, self)
            await self._waiting
        finally:
            self._waiting = None

    def _take(self) -> Beat:
        newest = int((time.monotonic_ns() - self._first) / self._period)
        newest = max(newest, self._next)
        merged = newest - self._next
        self._next = newest + 1
        return Beat(self._deadline(newest), merged)

    def _deadline(self, k: int) -> int:
        return self._first + round(k * self._period)


class _LoopClock:
    """The timerfd of one event loop and its pending deadlines; closed when the last ticker leaves."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self._fd = _checked(_LIBC.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))
        self._due: list[tuple[int, int, Ticker]] = []
        self._armed = 0
        self._members = 0
        self._entered = 0
        loop.add_reader(self._fd, self._fire)

    @classmethod
    def of(cls, loop: asyncio.AbstractEventLoop) -> _LoopClock:
        """Clock of a loop, created on first use."""
        if loop not in _CLOCKS:
            _CLOCKS[loop] = cls(loop)
        return _CLOCKS[loop]

    def enter(self, period: float) -> int:
        """Register a ticker; return its first deadline, ns."""
        self._members += 1
        self._entered += 1
        phase = self._entered * _GOLDEN % 1.0
        return time.monotonic_ns() + round(min(period, _SPREAD_NS) * phase)

    def leave(self, ticker: Ticker) -> None:
        """Remove a ticker."""
        self._due = [entry for entry in self._due if entry[2] is not ticker]
        heapq.heapify(self._due)
        self._members -= 1
        if self._members == 0:
            self.loop.remove_reader(self._fd)
            os.close(self._fd)
            del _CLOCKS[self.loop]

    def schedule(self, deadline: int, ticker: Ticker) -> None:
        """Wake the ticker at the deadline."""
        entry = (deadline, id(ticker), ticker)
        if entry not in self._due:  # still queued if the last wait for this deadline was cancelled
            heapq.heappush(self._due, entry)
        self._rearm()

    def _fire(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:  # re-armed between the wake-up of the loop and this call
            return
        now = time.monotonic_ns()
        while self._due and self._due[0][0] <= now:
            heapq.heappop(self._due)[2]._wake()
        self._armed = 0
        self._rearm()

    def _rearm(self) -> None:
        if self._due and self._due[0][0] != self._armed:
            self._armed = self._due[0][0]
            _arm(self._fd, self._armed)
