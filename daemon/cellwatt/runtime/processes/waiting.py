"""Waiting of a process for a ring or for its supervisor."""

from __future__ import annotations

import select
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Final

from cellwatt.ring import ItemReader

ALONE: Final = 5.0
"""s after the end of the supervisor in which the writer of a ring must come to its end, too."""


def turns(reader: ItemReader, control: Connection, pause: float) -> Iterator[None]:
    """Wait for news in a ring or for ``pause`` s, again and again, until its writer has ended and all was read.

    Where the supervisor is gone, the writer ends by itself; it is waited for ``ALONE`` s.
    """
    waiting = select.poll()
    waiting.register(reader.bell, select.POLLIN)
    waiting.register(control.fileno(), select.POLLHUP)
    end = float("inf")
    while not reader.over and time.monotonic() < end:
        for descriptor, event in waiting.poll(1e3 * pause):
            if descriptor == control.fileno() and event & (select.POLLHUP | select.POLLERR):
                waiting.unregister(descriptor)
                end = time.monotonic() + ALONE
        yield
