"""Unserved slots of a polled device by cause: the device, this program or the host."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from typing import Final

from cellwatt.processor import RunDelay
from cellwatt.ticker import Beat, Ticker

HOST: Final = "host stalled"
"""The PC was suspended, or ran other programs: neither the device nor this program caused the delay."""


class Slots:
    """The slots of one device at ``rate`` Hz over all its connections: ``async with slots: async for beat in slots``.

    Before a slot is served, ``missed`` receives the number of unserved slots before it, and the reason. The reason is
    measured (see ``RunDelay``). If the loop is late but computed for less than half of the time, the host delayed it.
    """

    def __init__(self, rate: float, missed: Callable[[int, str], None]) -> None:
        self._rate = rate
        self._period = round(1e9 / rate)
        self._missed = missed
        self._ticker: Ticker | None = None
        self._serving = False
        self.deadline = 0
        """Deadline of the last slot begun, ns of CLOCK_MONOTONIC; 0 before the first."""
        self._resumed = False
        self._idle = self._computed = self._held_up = self._begun_late = 0
        self._slow = (0, 0)
        """Number of slots that passed while an answer was awaited, and the delay by the host known so far, ns."""
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
        """Begin a connection; slots since the last connection count as disconnected."""
        self._resumed = self.deadline != 0
        self._serving = False

    def begin(self, beat: Beat) -> list[tuple[int, str]]:
        """Begin a slot; return the unserved slots before it by reason. Slow answers are counted one slot later."""
        before, self.deadline = self.deadline, beat.deadline
        kept = self._kept.look()
        self._begun_late = min(kept, max(time.monotonic_ns() - beat.deadline, 0))
        # The kernel may account stolen time only a tick after the hypervisor returns the core: look again a slot later.
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
        # Work that the host delayed is done in one go afterwards: this program did not cause it.
        computed = bool(self._idle) and ours >= max((beat.deadline - self._idle) / 2, kept + self._held_up)
        return _some(*told, (beat.merged - slow, "merged tick" if computed or not self._idle else HOST))

    def end(self) -> None:
        """End a slot: all of its answers have arrived or timed out."""
        self._idle, self._computed = time.monotonic_ns(), time.thread_time_ns()
        self._held_up = self._begun_late + self._kept.look()


def _some(*counts: tuple[int, str]) -> list[tuple[int, str]]:
    return [(n, reason) for n, reason in counts if n > 0]
