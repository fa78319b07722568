"""Waits for items of a ring or for the end of the supervisor."""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Final

from cellwatt.ring import ItemReader

QUIET: Final = 2.0
"""Longest time in s between turns when nothing arrives; less than the time after which a process counts as down."""
ALONE: Final = 5.0
"""Time in s, after the end of the supervisor, in which the writer of a ring must end."""


def turns(reader: ItemReader, control: Connection, moment: Callable[[], float] | None = None) -> Iterator[None]:
    """Yield when the ring is to be read, until its writer has ended and all items are read.

    While items other than figures arrive, at the time ``moment()``, monotonic s; otherwise, or with ``None``, at the
    next item or after ``QUIET`` s. After the end of the supervisor, the writer has ``ALONE`` s to end.
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
        if moment is None or not flowing:
            flowing = reader.listen()
            for descriptor, event in () if flowing else waiting.poll(1e3 * QUIET):
                flowing |= descriptor == reader.bell
                if descriptor == control.fileno() and event & (select.POLLHUP | select.POLLERR):
                    waiting.unregister(descriptor)
                    end = time.monotonic() + ALONE
            reader.quiet()
        if moment is not None and flowing:
            time.sleep(max(moment() - time.monotonic(), 0.0))
