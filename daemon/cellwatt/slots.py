"""Slots of a polled device that nobody served, and what held them up: the device, this program or the host."""

from __future__ import annotations

import os
import time
from typing import Final

from cellwatt.ticker import Beat

HOST: Final = "host stalled"
"""This PC stood still, or gave its cores to others: neither the device nor this program was at work."""


class Slots:
    """Follows the beats of one device at ``rate`` Hz over all its connections: ``begin`` and ``end`` once a slot.

    What held a slot up is measured. While an answer was awaited, the kernel counts how long this thread was ready to
    run and did not. While the next beat was awaited, a loop that came late though it did not compute was not let.
    """

    def __init__(self, rate: float) -> None:
        self._period = round(1e9 / rate)
        self.deadline = 0
        """Of the slot begun last, ns of CLOCK_MONOTONIC; 0 before the first."""
        self._resumed = False
        self._idle = self._computed = self._began_ready = self._held_up = 0

    def connected(self) -> None:
        """A connection begins: what went by since the last one was not served for want of it."""
        self._resumed = self.deadline != 0

    def begin(self, beat: Beat) -> list[tuple[int, str]]:
        """A slot begins; gives how many before it nobody served, by reason."""
        before, self.deadline = self.deadline, beat.deadline
        self._began_ready = _ready_ns()
        if self._resumed:
            self._resumed = False
            return _some((round((beat.deadline - before) / self._period) - 1, "disconnected"))
        slow = (self._idle - before) // self._period - 1 if before else 0
        slow = min(max(slow, 0), beat.merged)
        late = beat.merged - slow
        ours = time.thread_time_ns() - self._computed
        return _some(
            (slow, HOST if 2 * self._held_up >= slow * self._period else "slow answers"),
            (late, "merged tick" if 2 * ours >= late * self._period or not self._idle else HOST),
        )

    def end(self) -> None:
        """All of the slot's answers are there, or given up."""
        self._idle, self._computed = time.monotonic_ns(), time.thread_time_ns()
        self._held_up = _ready_ns() - self._began_ready


def _some(*counts: tuple[int, str]) -> list[tuple[int, str]]:
    return [(n, reason) for n, reason in counts if n > 0]


_schedstat: dict[int, int] = {}
"""Open files by process: one that was opened before a fork tells of the parent."""


def _ready_ns() -> int:
    """How long this process's first thread was ready to run and did not, ns; 0 where the kernel does not count it."""
    pid = os.getpid()
    if pid not in _schedstat:
        try:
            _schedstat[pid] = os.open(f"/proc/{pid}/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            _schedstat[pid] = -1
    descriptor = _schedstat[pid]
    return int(os.pread(descriptor, 128, 0).split()[1]) if descriptor >= 0 else 0
