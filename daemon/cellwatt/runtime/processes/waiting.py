"""Waiting of a process for a ring or for its supervisor."""

from __future__ import annotations

import select
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Final

from cellwatt.gather import next_moment
from cellwatt.ring import ItemReader

QUIET: Final = 2.0
"""s between turns where nothing comes: a process that is not heard of for longer counts as down."""
ALONE: Final = 5.0
"""s after the end of the supervisor in which the writer of a ring must come to its end, too."""


def turns(reader: ItemReader, control: Connection, period: float = 0.0, after: float = 0.0) -> Iterator[None]:
    """Turns to read a ring, until its writer has ended and all was read.

    While something but figures is read, they come each ``period`` s, ``after`` s past its moments; else, and where that
    is 0, at the next item or after ``QUIET`` s. Where the supervisor is gone, the writer ends by itself; it is waited
    for ``ALONE`` s.
    """
    waiting = select.poll()
    waiting.register(reader.bell, select.POLLIN)
    waiting.register(control.fileno(), select.POLLHUP)
    end = float("inf")
    while True:
        before = reader.count
        yield
        if reader.over or time.monotonic() >= end:
            return
        flowing = reader.count > before
        if not (period and flowing):
            flowing = reader.listen()
            for descriptor, event in () if flowing else waiting.poll(1e3 * QUIET):
                flowing |= descriptor == reader.bell
                if descriptor == control.fileno() and event & (select.POLLHUP | select.POLLERR):
                    waiting.unregister(descriptor)
                    end = time.monotonic() + ALONE
            reader.quiet()
        if period and flowing:
            time.sleep(max(next_moment(period, after) - time.monotonic(), 0.0))
