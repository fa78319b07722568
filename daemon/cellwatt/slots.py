"""Unserved slots of a polled device by cause: the device, this program or the host."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from typing import Final

from cellwatt.processor import RunDelay
from cellwatt.ticker import Beat, Ticker

HOST: Final = "host stalled"
"""This PC stood still, or gave its cores to others: neither the device nor this program was at work."""


class Slots:
    """The slots of one device at ``rate`` Hz over all its connections: ``async with slots: async for beat in slots``.

    Before a slot is served, ``missed`` is told how many before it were not, and why. The cause is measured (see
    ``RunDelay``). A loop that is late although it computed for less than half of the time was kept from running, too.
    """

    def __init__(self, rate: float, missed: Callable[[int, str], None]) -> None:
        self._rate = rate
        self._period = round(1e9 / rate)
        self._missed = missed
        self._ticker: Ticker | None = None
        self._serving = False
        self.deadline = 0
        """Of the slot begun last, ns of CLOCK_MONOTONIC; 0 before the first."""
        self._resumed = False
        self._idle = self._computed = self._held_up = self._begun_late = 0
        self._slow = (0, 0)
        """Slots that went by while an answer was awaited, and what is known yet of what held this PC up, ns."""
        self._kept = RunDelay()

    async def __aenter__(self) -> Slots:
        self.connected()
        self._ticker = await Ticker(self._rate).__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._ticker is not None:
            await self._ticker.__aexit__()
            self._ticker = None

    def __aiter__(self) -> AsyncIterator[Beat]:
        return self

    async def __anext__(self) -> Beat:
        if self._ticker is None:
            raise RuntimeError("slots fall due inside 'async with' only")
        if self._serving:
            self.end()
            self._serving = False
        beat = await anext(self._ticker)
        for slots, reason in self.begin(beat):
            self._missed(slots, reason)
        self._serving = True
        return beat

    def connected(self) -> None:
        """Begin a connection; slots since the last one were unserved for lack of a connection."""
        self._resumed = self.deadline != 0
        self._serving = False

    def begin(self, beat: Beat) -> list[tuple[int, str]]:
        """Begin a slot; return the unserved slots before it by reason. Slow answers are counted a slot late."""
        before, self.deadline = self.deadline, beat.deadline
        kept = self._kept.look()
        self._begun_late = min(kept, max(time.monotonic_ns() - beat.deadline, 0))
        # The kernel may count what the hypervisor took only a tick after it gave it back: asked again a slot later.
        slow, held_up = self._slow
        self._slow = (0, 0)
        held_up += self._held_up + kept
        told = [(slow, HOST if 2 * held_up >= slow * self._period else "slow answers")]
        if self._resumed:
            self._resumed = False
            return _some(*told, (round((beat.deadline - before) / self._period) - 1, "disconnected"))
        slow = (self._idle - before) // self._period - 1 if before else 0
        slow = min(max(slow, 0), beat.merged)
        if 2 * self._held_up >= slow * self._period:
            told.append((slow, HOST))
        else:
            self._slow = (slow, self._held_up)
        ours = time.thread_time_ns() - self._computed
        # What was held up is dealt with in one go afterwards: that is not this program's doing.
        computed = bool(self._idle) and ours >= max((beat.deadline - self._idle) / 2, kept + self._held_up)
        return _some(*told, (beat.merged - slow, "merged tick" if computed or not self._idle else HOST))

    def end(self) -> None:
        """End a slot: all of its answers have arrived or were given up."""
        self._idle, self._computed = time.monotonic_ns(), time.thread_time_ns()
        self._held_up = self._begun_late + self._kept.look()


def _some(*counts: tuple[int, str]) -> list[tuple[int, str]]:
    return [(n, reason) for n, reason in counts if n > 0]
